"""Initial guess of a step: polynomial extrapolation of the last states, or of their departures from
the free motion (core/protocols/integrator.py), which for smooth motion are accelerations."""

from collections.abc import Sequence
from copy import copy
from functools import cache
from math import comb

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray, Layout, StepFormula


@cache
def _weights(points: int, order: int, newest: int) -> FloatArray:
    """Extrapolation weights (points,) of degree order - 1 for a ring buffer whose newest state is
    row `newest`."""
    w = np.zeros(points)
    for j in range(order):  # x_{n+1} = sum (-1)^j C(order, j + 1) x_{n-j}
        w[(newest - j) % points] = (-1) ** j * comb(order, j + 1)
    return w


class RingBuffer:
    """Ring buffer of the last `points` states as rows (points, n), for extrapolation. newest: row
    of the last state; filled: number of states in it."""

    def __init__(self, points: int, x: FloatArray) -> None:
        self.rows = np.zeros((points, len(x)))
        self.newest, self.filled = -1, 0
        self.push(x)

    def copy(self) -> "RingBuffer":
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


def block_starts(layout: Layout) -> list[int]:
    """First unknown of each block."""
    return [layout[b.name].start for b in layout]


class Predictor:
    """Past states x and their departures d from the free motion of their step, and which of the two
    extrapolations was closer in the last step.

    With frequency w the extrapolation of d has (w h)^2 beta of the error of that of x: it is better
    for steps that resolve the motion, and worse for quasi-static ones. starts (blocks,): first
    unknown of each block, which are compared one by one; by_departure (n,): True where d is
    extrapolated, None while nothing has been compared.
    """

    def __init__(self, points: int, x: FloatArray, starts: Sequence[int] | IntArray) -> None:
        self.n, self.starts = len(x), np.array(starts, dtype=np.int64)
        self.both = np.concatenate((self.starts, self.n + self.starts))
        self.counts = np.diff(np.append(self.starts, self.n))
        self.ring = RingBuffer(points, np.concatenate((x, np.zeros(self.n))))
        self.by_departure: BoolArray | None = None

    def copy(self) -> "Predictor":
        """Independent copy."""
        other = copy(self)
        other.ring = self.ring.copy()
        return other

    @property
    def newest(self) -> FloatArray:
        """The last state (n,)."""
        return np.asarray(self.ring.rows[self.ring.newest][: self.n])

    def guess(self, step: StepFormula) -> FloatArray:
        """Extrapolated departure (n,) from the free motion of a step."""
        both = self.ring.predict()
        d = both[: self.n] - step.free
        if self.by_departure is not None:
            np.copyto(d, both[self.n :], where=self.by_departure)
        return step.steer(d)

    def push(self, x: FloatArray, d: FloatArray) -> None:
        """Stores an accepted state x and its departure d, (n,) each."""
        new = np.concatenate((x, d))
        worst = np.maximum.reduceat(np.abs(self.ring.predict() - new), self.both)
        count = len(self.starts)
        self.by_departure = (worst[count:] < worst[:count]).repeat(self.counts)
        self.ring.push(new)

    def moved(self, x: FloatArray) -> None:
        """Continues from the state x alone: nothing is known of the past."""
        self.ring.push(np.concatenate((x, np.zeros(self.n))))
        self.restart()

    def restart(self) -> None:
        """Drops all but the newest state: after a jump in a load or a change of active atoms."""
        self.ring.restart()
        self.by_departure = None
