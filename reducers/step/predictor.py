"""First guess of a step: extrapolation through the last states."""

from copy import copy
from functools import cache
from math import comb

import numpy as np

from sparsemor.core import FloatArray


@cache
def _weights(points: int, order: int, newest: int) -> FloatArray:
    """Weights on a ring of `points` rows whose newest is row `newest`; degree order - 1."""
    w = np.zeros(points)
    for j in range(order):  # x_{n+1} = sum (-1)^j C(order, j + 1) x_{n-j}
        w[(newest - j) % points] = (-1) ** j * comb(order, j + 1)
    return w


class Ring:
    """The last `points` states as rows (points, n); grows its order as states come."""

    def __init__(self, points: int, x: FloatArray) -> None:
        self.rows = np.zeros((points, len(x)))
        self.newest, self.filled = -1, 0
        self.push(x)

    def copy(self) -> "Ring":
        """Separate rows with the same states."""
        other = copy(self)
        other.rows = self.rows.copy()
        return other

    def push(self, x: FloatArray) -> None:
        points = len(self.rows)
        self.newest = (self.newest + 1) % points
        self.rows[self.newest] = x
        self.filled = min(self.filled + 1, points)

    def predict(self, order: int | None = None) -> FloatArray:
        """(n,) from the newest `order` states; from all there are when not given."""
        weights = _weights(len(self.rows), order or self.filled, self.newest)
        return np.asarray(weights.dot(self.rows))

    def guesses(self) -> FloatArray:
        """(filled, n) prediction of each order, 1 first."""
        weights = [_weights(len(self.rows), i + 1, self.newest) for i in range(self.filled)]
        return np.asarray(np.stack(weights).dot(self.rows))

    def restart(self) -> None:
        """Forget all but the newest state: after a jump in a load or a change of support."""
        self.filled = 1
