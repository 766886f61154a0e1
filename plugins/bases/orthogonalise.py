"""Linear independence and near-duplicates among the columns of a dictionary."""

from collections.abc import Sequence

import numpy as np

from sparsemor.core import FloatArray, IntArray
from sparsemor.core.linalg.dense import oriented_unit_columns


def independent(A: FloatArray, rtol: float) -> tuple[IntArray, FloatArray]:
    """Columns of A (n, k) that are linearly independent of earlier ones, and an orthonormal basis.

    Returns their indices (r,) and orthonormal columns (n, r) of the same span. A has unit columns;
    one is left out when its part outside the span of earlier ones has a norm of at most `rtol`.
    """
    n, k = A.shape
    if 0 < k <= n:
        # Householder: what is left of each column stands on the diagonal, where all were kept
        Q, R = np.linalg.qr(A)
        left = np.diagonal(R)
        if np.abs(left).min() > 2.0 * rtol:
            return np.arange(k), Q * np.where(left < 0.0, -1.0, 1.0)
    return _one_by_one(A, rtol)


def independent_atoms(
    found: FloatArray, rtol: float, orthonormal: bool
) -> tuple[FloatArray, IntArray]:
    """Unit atoms (n, k): columns of `found` (n, q) that are not zero and do not depend on earlier
    ones (`independent`), or with `orthonormal` the orthonormal columns of their span; and their
    numbers (k,)."""
    seen = np.flatnonzero(np.linalg.norm(found, axis=0) > 0.0)
    atoms = oriented_unit_columns(found[:, seen])
    kept, added = independent(atoms, rtol)
    return oriented_unit_columns(added if orthonormal else atoms[:, kept]), seen[kept]


def _one_by_one(A: FloatArray, rtol: float) -> tuple[IntArray, FloatArray]:
    """Gram-Schmidt version of `independent`, for dependent columns. Projecting twice is enough
    (Giraud, Langou, Rozloznik 2005, doi 10.1016/j.camwa.2005.08.009)."""
    Q, kept = np.zeros(A.shape), list[int]()
    for i, a in enumerate(A.T):
        basis = Q[:, : len(kept)]
        rest = a - basis @ (basis.T @ a)
        rest -= basis @ (basis.T @ rest)
        length = float(np.linalg.norm(rest))
        if length > rtol and len(kept) < len(a):
            Q[:, len(kept)] = rest / length
            kept.append(i)
    return np.array(kept, dtype=np.int64), Q[:, : len(kept)]


def merge(
    A: FloatArray, names: Sequence[str], tolerance: float
) -> tuple[FloatArray, tuple[str, ...], int]:
    """Unit columns A (n, k) without near-duplicates, their names, and the number of columns
    removed.

    Two columns are near-duplicates if the sine of the angle between them is at most `tolerance`.
    The first one stays, and its name lists those it absorbed. The sine is computed as the norm of a
    - (b.a) b: from 1 - (b.a)^2 it would be lost below 1e-8.
    """
    kept: list[int] = []
    absorbed: dict[int, list[str]] = {}
    all_cosines = A.T @ A
    for i, a in enumerate(A.T):
        if kept:
            cosines = all_cosines[kept, i]
            nearest = int(np.abs(cosines).argmax())
            b = kept[nearest]
            if np.linalg.norm(a - cosines[nearest] * A[:, b]) <= tolerance:
                absorbed.setdefault(b, []).append(names[i])
                continue
        kept.append(i)
    said = tuple(f"{names[i]} (also {', '.join(absorbed[i])})" if i in absorbed else names[i]
                 for i in kept)
    return np.ascontiguousarray(A[:, kept]), said, A.shape[1] - len(kept)
