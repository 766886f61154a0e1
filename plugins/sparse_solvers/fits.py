"""Comparison of least-squares fits on two supports."""

from math import sqrt

import numpy as np

from sparsemor.core import BoolArray, Quadratic
from sparsemor.plugins.sparse_solvers.factors import Factors
from sparsemor.plugins.sparse_solvers.least_squares_on_support import EPS

CLOSE = 1e-6
"""Relative difference up to which norms count as equal."""
WORTH = 1e-3
"""Gain from which a bound over all exchanges is worth computing."""


class Fits:
    """Least-squares fits on supports, compared by factors of a Gram matrix.

    gain, in the methods: fraction by which an exchange of columns must lower the residual norm.
    """

    def __init__(self, factors: Factors) -> None:
        self.factors = factors

    def never_valid(
        self, at: Quadratic, support: BoolArray, everyone: BoolArray, gain: float
    ) -> bool:
        """True if even least squares on all columns (mask `everyone`) does not lower the residual
        norm by the fraction `gain`, so that no exchange does."""
        own, whole = self.factors.fitted(at, support), self.factors.fitted(at, everyone)
        if gain < WORTH or own is None or whole is None:
            return False
        square, step = at.left()[0], whole[1]
        base = square - float(at.slope.take(own[0]).dot(own[1]))
        best = square - float(at.slope.take(whole[0]).dot(step))
        error = (EPS * len(step) + at.error.gram) * float(step.dot(step)) + CLOSE * square
        return best - error > (1.0 - gain) ** 2 * (base + error)

    def better(
        self, at: Quadratic, support: BoolArray, kept: BoolArray, gain: float
    ) -> BoolArray | None:
        """Mask `kept` if it lowers the residual norm by more than the fraction `gain`, else
        `support` itself; None if rounding decides."""
        if kept is support or np.array_equal(kept, support):
            return support
        move = self.factors.move(at, support, kept)
        if move is None:
            return None
        rise, error = move.rise(at)
        if rise > error:
            return support  # worse than the step's solution, which its own fit does not exceed
        return self.compared(at, support, kept, (rise, error), gain)

    def compared(
        self, at: Quadratic, support: BoolArray, kept: BoolArray, change: tuple[float, float],
        gain: float,
    ) -> BoolArray | None:
        """Result of `better` from the residual norms; change: rise of the squared norm from the
        coefficients of `at` to least squares on `kept`, and its error."""
        rise, error = change
        own = self.factors.fitted(at, support)
        if own is None:
            return None
        square, hidden = at.left()
        z, fallen = at.lengths * at.c, float(at.slope[support].dot(own[1]))
        floor = 100.0 * EPS * sqrt(float(z.dot(z)) + hidden)
        base, new = (sqrt(max(s, 0.0)) for s in (square - fallen, square + rise))
        if 0.5 * floor < base < 2.0 * floor:
            return None
        least = base - max(gain * base, floor)
        top = max(base, new)
        close = CLOSE * top + at.error.sizes * floor
        if base > floor and not abs(new - least) * top > close * top + error:
            return None
        return support if base <= floor or new >= least else kept
