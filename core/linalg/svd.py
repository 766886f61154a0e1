"""Singular value decomposition with a second algorithm where the first fails."""

import numpy as np
from scipy import linalg

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError


def svd(A: FloatArray, full_matrices: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Singular value decomposition A = U diag(s) Vt: U (m, p), s (p,), Vt (p, n), p = min(m, n).

    U and Vt are square if `full_matrices`. Divide and conquer (LAPACK's gesdd) fails for some
    well-conditioned matrices: it did for one of condition 4 with 606 of 607 singular values equal
    to 1. QR iteration (gesvd) is slower, and is used then. Raises InputError where that fails too,
    or where A is not finite.
    """
    try:
        U, s, Vt = np.linalg.svd(A, full_matrices=full_matrices)
    except np.linalg.LinAlgError:
        U, s, Vt = _by_qr_iteration(A, full_matrices)
    return U, s, Vt


def _by_qr_iteration(
    A: FloatArray, full_matrices: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    size = " x ".join(map(str, A.shape))
    if not np.isfinite(A).all():
        raise InputError(f"a matrix of {size} has entries that are not finite: it has no singular "
                         "values")
    try:
        U, s, Vt = linalg.svd(A, full_matrices=full_matrices, lapack_driver="gesvd")
    except np.linalg.LinAlgError:
        raise InputError(f"the singular values of a matrix of {size} were not found, neither by "
                         "divide and conquer nor by QR iteration: take a few atoms, modes or rows "
                         "more or less") from None
    return U, s, Vt
