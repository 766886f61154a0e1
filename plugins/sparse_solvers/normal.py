"""Least squares on columns that stay: everything that does not depend on the right-hand side."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.linalg import lapack

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray

NEARLY = 1e-9
"""Reciprocal condition number below which normal equations are not inverted."""


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """Some columns (s) of a matrix of m rows: Q (m, s) and its transpose, R (s, s) upper."""

    columns: IntArray
    Q: FloatArray
    Qt: FloatArray
    R: FloatArray

    @classmethod
    def of(cls, J: FloatArray, columns: IntArray, rank_rtol: float) -> "Columns | None":
        """None when the columns J[:, columns] are dependent, or none."""
        if not 0 < len(columns) <= len(J):
            return None
        # LAPACK itself: a support or proposal is factorized anew every few steps
        QR, tau = lapack.dgeqrf(np.asfortranarray(J[:, columns]), overwrite_a=1)[:2]
        R = np.triu(QR[: len(columns)])
        if not float(lapack.dtrcon(R)[0]) > rank_rtol:
            return None
        Q = lapack.dorgqr(QR, tau, overwrite_a=1)[0]
        return cls(columns, Q, Q.T, R)

    def step(self, r: FloatArray) -> FloatArray:
        """(s,) what takes the coefficients of the least squares away from those at residual r."""
        return np.asarray(lapack.dtrtrs(self.R, self.Qt.dot(r))[0])

    def inverse(self, k: int) -> FloatArray:
        """(k, m) what `step` is as a matrix, with rows of zeros for all other columns."""
        W = np.zeros((k, len(self.Q)))
        W[self.columns] = lapack.dtrtrs(self.R, self.Qt)[0]
        return W

    def left(self, r: FloatArray) -> FloatArray:
        """(m,) the part of r that the columns do not reach."""
        return np.asarray(r - self.Q.dot(self.Qt.dot(r)))

    def norm(self, r: FloatArray) -> float:
        """Norm of `left(r)`."""
        q, whole = self.Qt.dot(r), float(r.dot(r))
        square = whole - float(q.dot(q))
        if square > 1e-8 * whole:  # cancellation takes half of the digits at most
            return sqrt(square)
        rest = r - self.Q.dot(q)
        return sqrt(float(rest.dot(rest)))


@dataclass(frozen=True, slots=True, eq=False)
class Everyone:
    """All columns at once: W (k, m) with z - W r the least-squares coefficients; rows of columns
    that no row sees are zero. R (s, s) upper: of the columns that are seen."""

    W: FloatArray
    columns: IntArray
    R: FloatArray

    @classmethod
    def of(cls, J: FloatArray, seen: BoolArray, rank_rtol: float) -> "Everyone | None":
        """None for dependent columns, or so nearly so that normal equations would be rounding."""
        f = Columns.of(J, np.flatnonzero(seen), max(rank_rtol, NEARLY))
        if f is None:
            return None
        return cls(f.inverse(J.shape[1]), f.columns, f.R)

    def holding(self, out: IntArray) -> FloatArray | None:
        """W (k, m) for the few columns `out` held at zero; None where rounding forbids it."""
        at = np.flatnonzero(np.isin(self.columns, out))
        if not len(at):
            return self.W
        inverse = lapack.dtrtri(self.R)[0]
        some, seen = inverse[at], self.columns[at]
        # N = (J^T J)^-1 = R^-1 R^-T: what a column held at zero does to the others
        taken, failed = lapack.dposv(some @ some.T, self.W[seen])[1:]
        if failed:
            return None
        W = self.W.copy()
        W[self.columns] -= inverse @ (some.T @ taken)
        W[seen] = 0.0
        return W
