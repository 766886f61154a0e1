"""Least squares on subsets of columns, from the Gram matrix of all of them."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.linalg import blas, lapack

from sparsemor.core import BoolArray, FloatArray, IntArray, Quadratic
from sparsemor.plugins.sparse_solvers.least_squares_on_support import EPS

NEARLY = 1e-12
"""Squared distance of a unit column from the span of the others, at or below which its coefficient
is dominated by rounding."""


OFTEN = 2
"""Number of solutions with one factor after which its inverse is computed: a product is several
times as fast as two triangular solves of this size, and as accurate as normal equations are."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Subset of s columns out of k.

    flat (s, s): positions of its Gram matrix in that of all columns, upper triangle in Fortran
    order; None: all columns.
    """

    columns: IntArray
    flat: IntArray | None

    @classmethod
    def of(cls, columns: IntArray, k: int) -> "Part":
        if len(columns) == k:
            return cls(columns, None)
        return cls(columns, positions(columns, columns, k))


@dataclass(frozen=True, slots=True, eq=False)
class Swap:
    """Columns of a new support, the first `kept` of them, followed by those that leave the old one;
    flat: positions as in `Part`."""

    columns: IntArray
    flat: IntArray
    kept: int

    @classmethod
    def of(cls, old: BoolArray, new: BoolArray) -> "Swap":
        columns = np.concatenate([np.flatnonzero(new), np.flatnonzero(old & ~new)])
        return cls(columns, positions(columns, columns, len(old)), int(np.count_nonzero(new)))


class Normal:
    """Cholesky factor R (s, s), upper, of normal equations; low: smallest squared pivot."""

    __slots__ = ("R", "inverse", "low", "solved")

    def __init__(self, R: FloatArray, low: float) -> None:
        self.R, self.low, self.solved = R, low, 0
        self.inverse: FloatArray | None = None

    @classmethod
    def of(cls, gram: FloatArray, overwrite: bool) -> "Normal | None":
        """Cholesky factorization of a Gram matrix (s, s), upper triangle; None where it is singular
        to rounding."""
        R, failed = lapack.dpotrf(gram, 0, 0, overwrite)
        if failed:
            return None
        low = float(R.diagonal().min()) ** 2
        return cls(R, low) if low > NEARLY else None

    def solve(self, right: FloatArray) -> FloatArray:
        self.solved += 1
        if self.solved == OFTEN:
            self.inverse = lapack.dpotri(self.R)[0]
        if self.inverse is None:
            return np.asarray(lapack.dpotrs(self.R, right)[0])
        return np.asarray(blas.dsymv(1.0, self.inverse, right))

    def inverted(self) -> FloatArray:
        """Inverse matrix (s, s), both triangles."""
        if self.inverse is None:
            self.inverse = lapack.dpotri(self.R)[0]
        upper = np.triu(self.inverse)
        whole: FloatArray = upper + np.triu(upper, 1).T
        return whole

    def rounding(self, x: FloatArray) -> float:
        """Absolute error of the coefficients x (s,) due to rounding of the Gram matrix."""
        return EPS * len(x) / self.low * sqrt(float(x.dot(x)))


@dataclass(frozen=True, slots=True, eq=False)
class Move:
    """Exchange of columns of a support.

    gone (s + d, d): Gram matrix of the d columns that leave, with rows as in `swap`, which has s
    kept columns; normal: normal equations of the kept columns.
    """

    swap: Swap
    gone: FloatArray
    normal: Normal

    @classmethod
    def of(cls, gram: FloatArray, swap: Swap) -> "Move | None":
        part, n = gathered(gram, swap.flat), swap.kept
        normal = Normal.of(part[:n, :n].T, False)
        return None if normal is None else cls(swap, part[:, n:], normal)

    def rise(self, at: Quadratic) -> tuple[float, float]:
        """Increase of the squared residual norm from that at c to that of least squares on the new
        support, and its error."""
        n, columns = self.swap.kept, self.swap.columns
        slope, c = at.slope.take(columns), at.c.take(columns[n:])
        left = slope - self.gone.dot(c)
        kept = left[:n]
        step = self.normal.solve(kept)
        rise = -float(c.dot(slope[n:] + left[n:])) - float(step.dot(kept))
        moved = float(step.dot(step)) + float(c.dot(c))
        return rise, (EPS * n + at.error.gram) * moved


def positions(rows: IntArray, columns: IntArray, k: int) -> IntArray:
    """Positions of gram[rows, columns] in the upper triangle of gram (k, k) in Fortran order."""
    i, j = rows[:, None], columns[None, :]
    found: IntArray = np.minimum(i, j) + k * np.maximum(i, j)
    return found


def gathered(gram: FloatArray, flat: IntArray) -> FloatArray:
    return gram.ravel("K").take(flat)
