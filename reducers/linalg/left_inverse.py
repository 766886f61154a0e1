"""Left inverse of a block's rows: least squares for the coefficients of its atoms, as a matrix."""

import numpy as np
from scipy.linalg import lapack

from sparsemor.core import FloatArray, SolveFailed, Status

RANK_RTOL = 1e-14
"""Reciprocal condition number of the scaled rows below which the atoms are linearly dependent."""
SAMPLED_RTOL = 1e-13
"""Reciprocal condition number of scaled sampled rows below which these do not distinguish the
atoms."""


def left_inverse(name: str, A: FloatArray, sampled: bool = False) -> FloatArray:
    """Left inverse (k, l) with left @ A = 1 for A (l, k), by least squares on unit columns where l
    > k.

    Raises SolveFailed (rank deficient) naming the block `name` where the columns are linearly
    dependent: an overcomplete dictionary has no unique coefficients. sampled: True for rows drawn
    by a sampler and the active atoms of a selection.
    """
    rows, k = A.shape
    if rows < k:
        raise deficient(name, f"{k} active atoms, {rows} rows" if sampled else
                        f"{k} atoms, {rows} rows", sampled)
    norms = np.sqrt(squares(A))
    if not norms.all():
        at = "the" if sampled else "its"
        raise deficient(name, f"{int((norms == 0).sum())} atoms vanish on {at} rows", sampled)
    if not k:
        return np.zeros((0, rows))
    # LAPACK without wrappers: half of what an exchange of atoms costs would be theirs
    packed, tau = lapack.dgeqrf(A / norms)[:2]
    R = packed[:k]
    rcond = float(lapack.dtrcon(R)[0])
    if not rcond > (SAMPLED_RTOL if sampled else RANK_RTOL):
        raise deficient(name, f"reciprocal condition {rcond:.1e}" if sampled else (
            f"its {k} atoms depend on each other, reciprocal condition {rcond:.1e}: take "
            "fewer atoms or merge near-duplicates"), sampled)
    Q = lapack.dorgqr(packed, tau)[0]
    return np.asarray(lapack.dtrtrs(R, Q.T)[0] / norms[:, None])


def deficient(name: str, detail: str, sampled: bool = False) -> SolveFailed:
    """Exception for rows that do not determine the coefficients of a block."""
    return SolveFailed(Status.RANK_DEFICIENT, 0.0, name, detail, sampled=sampled)


def squares(A: FloatArray) -> FloatArray:
    """Squared lengths (k,) of the columns of A (m, k)."""
    return np.asarray(np.einsum("ij,ij->j", A, A))
