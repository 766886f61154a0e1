"""Coefficients of a state under atoms: a product where they are orthonormal, else least squares."""

import numpy as np

from sparsemor.core.arrays import FloatArray

ORTHONORMAL = 1e-14
"""Size of the entries of A^T A - 1 that rounding leaves of orthonormal atoms."""


def orthonormal(A: FloatArray) -> bool:
    """True if A (n, k) has orthonormal columns, by what A^T A - 1 does to fixed random vectors: of
    k of them the result is expected to be as large as all its entries. A^T A takes n k^2."""
    n, k = A.shape
    if k > n:
        return False
    z = np.random.default_rng(k).standard_normal((k, 4))
    off = A.T @ (A @ z) - z
    return bool(np.linalg.norm(off) < ORTHONORMAL * k * np.sqrt(z.shape[1]))


def least_squares_coefficients(A: FloatArray, states: FloatArray) -> FloatArray:
    """c (k, j) with least |A c - states|, and least |c| among these; A (n, k), states (n, j).

    For orthonormal A, c = A^T states: 0.1 s with 7000 columns, where a factorization takes minutes.
    """
    if orthonormal(A):
        return np.asarray(A.T @ states)
    return np.asarray(np.linalg.lstsq(A, states, rcond=None)[0])
