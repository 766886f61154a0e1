"""Least squares on subsets of the columns of one constant matrix."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray

KEPT = 64
"""Number of subsets whose factors are kept; subsets of active columns often recur."""
WORK = 64
"""Length of the working array of LAPACK for one right-hand side."""


class Factors(NamedTuple):
    """QR factorization of s columns: their numbers (s,), the reflectors of Q below the diagonal of
    R (m, s), and the scalars tau (s,) of these, as LAPACK stores them."""

    columns: IntArray
    packed: FloatArray
    tau: FloatArray


def is_unit_matrix(A: FloatArray) -> bool:
    """True if A (m, k) is the unit matrix, digit for digit."""
    m, k = A.shape
    return m == k and np.count_nonzero(A) == k and bool((np.diagonal(A) == 1.0).all())


class ColumnSubsets:
    """Least squares min |A x - b| over x that vanish outside a subset of the columns of A (m, k).
    Of the unit matrix, as orthonormal atoms have, x is the part of b in the subset.

    Factors of recent subsets are kept. They do not depend on the order of the calls, so that
    several threads may share one object. rank_rtol: reciprocal condition number of unit columns at
    which columns count as linearly dependent.
    """

    def __init__(self, A: FloatArray, rank_rtol: float) -> None:
        self.A, self.rank_rtol, self.unit = A, rank_rtol, is_unit_matrix(A)
        self._factors = lru_cache(maxsize=KEPT)(self._factorized)
        self._inverse = lru_cache(maxsize=KEPT)(self._inverted)

    def independent(self, subset: BoolArray) -> bool:
        """True if the columns in the mask (k,) are linearly independent."""
        return self.unit or self._factors(subset.tobytes()) is not None

    def solution(self, subset: BoolArray, b: FloatArray) -> FloatArray | None:
        """Least-squares solution x (k,); None for linearly dependent columns."""
        if self.unit:
            return np.where(subset, b, 0.0)
        f = self._factors(subset.tobytes())
        if f is None:
            return None
        x = np.zeros(len(subset))
        s = len(f.columns)
        if s:
            x[f.columns] = lapack.dtrtrs(f.packed[:s], _turned(f, b)[:s])[0]
        return x

    def least_norm_solution(self, subset: BoolArray, b: FloatArray) -> FloatArray:
        """Least-squares solution x (k,), of least norm for linearly dependent columns: combinations
        with singular values below `rank_rtol` times the largest count as zero."""
        x = self.solution(subset, b)
        if x is None:
            x = np.zeros(len(subset))
            x[subset] = self._inverse(subset.tobytes()).dot(b)
        return x

    def left_inverse(self, subset: BoolArray) -> FloatArray | None:
        """Matrix (s, m) that maps b to the s nonzero entries of the least-squares solution; None
        for linearly dependent columns."""
        if self.unit:
            return np.asarray(self.A[subset])
        f = self._factors(subset.tobytes())
        if f is None:
            return None
        s = len(f.columns)
        if not s:
            return np.zeros((0, len(self.A)))
        # A = Q R: R^-1 Q^T, with the first s columns of Q
        return np.asarray(lapack.dtrtrs(f.packed[:s], lapack.dorgqr(f.packed, f.tau)[0].T)[0])

    def squared_residual(self, subset: BoolArray, b: FloatArray) -> float | None:
        """|A x - b|^2 of the least-squares solution x; None for linearly dependent columns."""
        if self.unit:
            rest = b[~subset]
            return float(rest.dot(rest))
        f = self._factors(subset.tobytes())
        if f is None:
            return None
        rest = _turned(f, b)[len(f.columns) :]  # the part of Q^T b outside the range of A
        return float(rest.dot(rest))

    def _factorized(self, mask: bytes) -> Factors | None:
        """QR factors of the columns in a mask (k,), given as bytes; None where they are linearly
        dependent."""
        columns = np.flatnonzero(np.frombuffer(mask, dtype=np.bool_))
        A = self.A[:, columns]
        m, s = A.shape
        if s > m:
            return None
        if not s:
            return Factors(columns, np.zeros((m, 0)), np.zeros(0))
        packed, tau = lapack.dgeqrf(A)[:2]
        # reciprocal condition number of R, which is that of A
        if not float(lapack.dtrcon(packed[:s])[0]) > self.rank_rtol:
            return None
        return Factors(columns, packed, tau)

    def _inverted(self, mask: bytes) -> FloatArray:
        return pseudo_inverse(self.A[:, np.frombuffer(mask, dtype=np.bool_)], self.rank_rtol)


def pseudo_inverse(A: FloatArray, rtol: float) -> FloatArray:
    """Pseudo-inverse (k, m) of A (m, k) without the singular values below rtol times the
    largest."""
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    kept = s > rtol * s.max(initial=0.0)
    return np.ascontiguousarray((Vt[kept].T / s[kept]) @ U[:, kept].T)


def _turned(f: Factors, b: FloatArray) -> FloatArray:
    """Q^T b (m,)."""
    if not len(f.columns):
        return b
    return np.asarray(lapack.dormqr("L", "T", f.packed, f.tau, b[:, None], WORK)[0][:, 0])
