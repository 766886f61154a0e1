"""Singular values and vectors: one way for all, with a second algorithm behind the first."""

import numpy as np
from scipy import linalg

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError


def svd(A: FloatArray, full_matrices: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
    """U (m, p), s (p,), Vt (p, n) with A = U diag(s) Vt, p = min(m, n); square U, Vt where full.

    Divide and conquer (LAPACK's gesdd) gives up on some matrices that are harmless: it did so on
    the force modes of the brake disk's heat at their points, a matrix of condition 4 of which 606
    of 607 singular values are 1. QR iteration (gesvd) is slower, and is used then.
    InputError where that fails too, or where A is not finite.
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
