"""Unit columns, mutual coherence and condition number of a matrix."""

import numpy as np

from sparsemor.core.arrays import FloatArray


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
