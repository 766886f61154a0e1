"""Dense matrices: coefficients of states in a basis, unit columns, coherence and condition number,
singular value decomposition."""

import numpy as np
from scipy import linalg

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError

ORTHONORMAL = 1e-14
"""Magnitude of the entries of A^T A - I that round-off causes for orthonormal columns."""


def orthonormal(A: FloatArray) -> bool:
    """True if A (n, k) has orthonormal columns, estimated with random vectors.

    The norm of (A^T A - I) z for a Gaussian vector z is expected to be the Frobenius norm of A^T A
    - I; A^T A itself would take n k^2 operations. The vectors are the same in each call.
    """
    n, k = A.shape
    if k > n:
        return False
    z = np.random.default_rng(k).standard_normal((k, 4))
    off = A.T @ (A @ z) - z
    return bool(np.linalg.norm(off) < ORTHONORMAL * k * np.sqrt(z.shape[1]))


def least_squares_coefficients(A: FloatArray, states: FloatArray) -> FloatArray:
    """Coefficients c (k, j) with least |A c - states|, and least |c| among these.

    A (n, k), states (n, j). For orthonormal A, c = A^T states: 0.1 s with 7000 columns, where a
    factorization takes minutes.
    """
    if orthonormal(A):
        return np.asarray(A.T @ states)
    return np.asarray(np.linalg.lstsq(A, states, rcond=None)[0])


def unit_columns(A: FloatArray) -> FloatArray:
    """Columns of A (m, k) scaled to unit length; columns of zeros stay zero."""
    norms = np.linalg.norm(A, axis=0)
    return np.asarray(A / np.where(norms > 0.0, norms, 1.0))


def oriented_unit_columns(A: FloatArray) -> FloatArray:
    """Columns of A (n, k) scaled to length 1, with the sign that makes the largest entry positive.

    Among entries whose magnitudes are equal within 1e-8 the first decides, so that round-off does
    not change the sign.
    """
    size = np.abs(A)
    first = (size >= (1.0 - 1e-8) * size.max(axis=0)).argmax(axis=0)
    sign = np.where(A[first, np.arange(A.shape[1])] < 0.0, -1.0, 1.0)
    return np.ascontiguousarray(unit_columns(A) * sign)


def coherence(A: FloatArray) -> float:
    """Largest |cosine| between two different columns of A (m, k); 0 for fewer than two."""
    if A.shape[1] < 2:
        return 0.0
    F = unit_columns(A)
    G = np.abs(F.T @ F)
    np.fill_diagonal(G, 0.0)
    return float(min(1.0, G.max()))


def condition_number(A: FloatArray) -> float:
    """Condition number of A (m, k): largest over smallest of its min(m, k) singular values; inf
    when A lacks rank."""
    s = np.linalg.svd(A, compute_uv=False)
    if s.size == 0:
        return 1.0
    lost = s[-1] <= max(A.shape) * np.finfo(np.float64).eps * s[0]
    return float("inf") if lost else float(s[0] / s[-1])


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
    """Singular value decomposition by LAPACK's slower routine, which converges where divide and
    conquer does not. Raises InputError where neither does."""
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
