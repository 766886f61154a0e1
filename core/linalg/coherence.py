"""Coherence of the columns of a matrix."""

import numpy as np

from sparsemor.core.arrays import FloatArray


def unit_columns(A: FloatArray) -> FloatArray:
    """A (m, k) with columns of unit length; columns of zeros stay zero."""
    norms = np.linalg.norm(A, axis=0)
    return np.asarray(A / np.where(norms > 0.0, norms, 1.0))


def oriented_unit_columns(A: FloatArray) -> FloatArray:
    """A (n, k) with columns of length 1 whose entry of largest size is positive.

    Of entries equal to 1e-8 the first decides, so that round-off does not turn a symmetric one.
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
    """Largest over smallest of the min(m, k) singular values of A; inf when A lacks rank."""
    s = np.linalg.svd(A, compute_uv=False)
    if s.size == 0:
        return 1.0
    lost = s[-1] <= max(A.shape) * np.finfo(np.float64).eps * s[0]
    return float("inf") if lost else float(s[0] / s[-1])
