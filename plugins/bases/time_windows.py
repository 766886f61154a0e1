"""Proper orthogonal decomposition by time windows: one per window, the atoms pooled."""

from collections.abc import Callable

import numpy as np

from sparsemor.core import Dictionary, FloatArray, InputError, needs_chunks
from sparsemor.plugins.bases.blocked_svd import Snapshots
from sparsemor.plugins.bases.inner_product import InnerProduct
from sparsemor.plugins.bases.orthogonalise import independent, merge
from sparsemor.plugins.bases.randomized_svd import held


def too_many_windows(windows: int, snapshots: int, block: str) -> str:
    """Message that there are more time windows than snapshots."""
    return f"{windows} windows were requested of {snapshots} snapshots of {block}: take fewer"


def pooled(
    decomposed: Callable[[FloatArray], Dictionary], A: FloatArray, offset: FloatArray,
    product: InnerProduct, windows: int, tolerance: float, block: str,
) -> Dictionary:
    """Dictionary of the atoms of `windows` consecutive parts of the snapshots A (n, M), pooled.

    A window without motion contributes no atoms. Raises InputError for more windows than snapshots,
    or where no window has an atom.
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
        **shares(lambda U, used: share(A, offset, U, used), Q, product), "snapshots": M})


def shares(
    captured: Callable[[FloatArray, InnerProduct], float], U: FloatArray, product: InnerProduct
) -> dict[str, float]:
    """Reported shares of the snapshots' squared norm in the span of U (n, k): `energy` in the
    2-norm, and `energy_in_product` where another product is used.

    captured(Q, product): share in the span of columns Q that are orthonormal in a product.
    """
    if product.euclidean:
        return {"energy": captured(U, product)}
    return {"energy": captured(np.linalg.qr(U)[0], InnerProduct()),
            "energy_in_product": captured(product.qr(U)[0], product)}


def share(A: FloatArray, offset: FloatArray, Q: FloatArray, product: InnerProduct) -> float:
    """Share of the summed squared norms of the columns of A (n, M) less `offset` in the span of
    columns Q (n, k), orthonormal in the product."""
    if not needs_chunks(A):
        return held(A - offset[:, None], Q, product)
    snapshots = Snapshots.of(A, offset, False, product)
    return 1.0 - snapshots.missed(Q, snapshots.coefficients(Q).T) ** 2 / snapshots.total
