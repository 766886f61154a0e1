"""Initial guess of a step: polynomial extrapolation of the last states."""

from copy import copy
from functools import cache
from math import comb

import numpy as np

from sparsemor.core import FloatArray


@cache
def _weights(points: int, order: int, newest: int) -> FloatArray:
    """Extrapolation weights (points,) of degree order - 1 for a ring buffer whose newest state is
    row `newest`."""
    w = np.zeros(points)
    for j in range(order):  # x_{n+1} = sum (-1)^j C(order, j + 1) x_{n-j}
        w[(newest - j) % points] = (-1) ** j * comb(order, j + 1)
    return w


class Ring:
    """Ring buffer of the last `points` states as rows (points, n), for extrapolation."""

    def __init__(self, points: int, x: FloatArray) -> None:
        self.rows = np.zeros((points, len(x)))
        self.newest, self.filled = -1, 0
        self.push(x)

    def copy(self) -> "Ring":
        """Independent copy."""
        other = copy(self)
        other.rows = self.rows.copy()
        return other

    def push(self, x: FloatArray) -> None:
        points = len(self.rows)
        self.newest = (self.newest + 1) % points
        self.rows[self.newest] = x
        self.filled = min(self.filled + 1, points)

    def predict(self, order: int | None = None) -> FloatArray:
        """Extrapolated state (n,) from the newest `order` states; from all stored ones if None."""
        weights = _weights(len(self.rows), order or self.filled, self.newest)
        return np.asarray(weights.dot(self.rows))

    def guesses(self) -> FloatArray:
        """Extrapolated states (filled, n) of all orders, order 1 first."""
        weights = [_weights(len(self.rows), i + 1, self.newest) for i in range(self.filled)]
        return np.asarray(np.stack(weights).dot(self.rows))

    def restart(self) -> None:
        """Drops all but the newest state: after a jump in a load or a change of active atoms."""
        self.filled = 1
