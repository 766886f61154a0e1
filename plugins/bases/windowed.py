"""A decomposition of each of several windows of time, with the atoms of all of them pooled."""

from collections.abc import Callable

import numpy as np

from sparsemor.core import Dictionary, FloatArray, InputError
from sparsemor.core.linalg.snapshots import large
from sparsemor.plugins.bases.blocked_svd import Snapshots
from sparsemor.plugins.bases.orthogonalise import independent, merge
from sparsemor.plugins.bases.randomized_svd import held


def too_many_windows(windows: int, snapshots: int, block: str) -> str:
    """The sentence on windows that would be empty."""
    return f"{windows} windows were requested of {snapshots} snapshots of {block}: take fewer"


def pooled(
    decomposed: Callable[[FloatArray], Dictionary], A: FloatArray, offset: FloatArray,
    windows: int, tolerance: float, block: str,
) -> Dictionary:
    """Atoms (n, k) of `windows` parts of the snapshots A (n, M), one after another in time.

    A window without motion has no atoms. Raises InputError for more windows than snapshots, or
    where no window has an atom.
    """
    M = A.shape[1]
    if windows > M:
        raise InputError(too_many_windows(windows, M, block), "windows")
    parts, names, ranks = list[FloatArray](), list[str](), list[int]()
    for number, columns in enumerate(np.array_split(np.arange(M), windows)):
        part = np.asarray(A[:, columns])
        if not (part - offset[:, None]).any():
            ranks.append(0)
            continue
        d = decomposed(part)
        parts.append(d.atoms)
        ranks.append(d.atoms.shape[1])
        names += [f"window {number} {name}" for name in d.provenance]
    if not parts:
        raise InputError(f"the {M} snapshots of {block} do not differ from their mean: nothing is "
                         "left to decompose; set centred: false or train with a load")
    atoms, said, merged = merge(np.concatenate(parts, axis=1), names, tolerance)
    _, Q = independent(atoms, 1e-13)
    return Dictionary(atoms, offset, said, {
        "windows": windows, "kept": atoms.shape[1], "merged": merged,
        "kept_each": ", ".join(map(str, ranks)), "numerical_rank": Q.shape[1],
        "energy": share(A, offset, Q), "snapshots": M})


def share(A: FloatArray, offset: FloatArray, Q: FloatArray) -> float:
    """Of the squares of A (n, M) less `offset`, what orthonormal Q (n, k) hold."""
    if not large(A):
        return held(A - offset[:, None], Q)
    snapshots = Snapshots.of(A, offset, False)
    return 1.0 - snapshots.missed(Q, snapshots.coefficients(Q).T) ** 2 / snapshots.total
