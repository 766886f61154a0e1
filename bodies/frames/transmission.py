"""Gears and racks between two frames in space: one constraint on an angle and another angle or
distance (notation: items.py)."""

from dataclasses import dataclass
from math import atan2, pi

import numpy as np

from sparsemor.bodies.frames.attitude import Attitude, attitude
from sparsemor.bodies.frames.items import SpatialItem
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import FloatArray

Jet = tuple[float, FloatArray, FloatArray]
"""A function of the rigid coordinates of a body (n,) with its first and second derivatives."""


@dataclass(frozen=True, slots=True, eq=False)
class Turned:
    """Angle of a body, rad, about an axis fixed in space: atan2(A d . e_2, A d . e_1); own (3,) = d
    in body axes."""

    own: FloatArray
    first: FloatArray
    second: FloatArray

    def __call__(self, y: FloatArray) -> Jet:
        turn = attitude(y[3:])
        (c, c1, c2), (s, s1, s2) = (_cosine(turn, self.own, e) for e in (self.first, self.second))
        # gradient and Hessian of atan2(s, c) by those of s and c
        size = c * c + s * s
        along = (c * s1 - s * c1) / size
        bend = (np.outer(s1, c1) - np.outer(c1, s1) + c * s2 - s * c2) / size - np.outer(
            along, 2.0 * (c * c1 + s * s1) / size)
        first, second = np.zeros(len(y)), np.zeros((len(y), len(y)))
        first[3:], second[3:, 3:] = along, bend
        return atan2(s, c), first, second


def _cosine(turn: Attitude, d: FloatArray, e: FloatArray) -> Jet:
    return float(turn.A.dot(d).dot(e)), e.dot(turn.of_body(d)), turn.bend(e, d)


@dataclass(frozen=True, slots=True, eq=False)
class Shifted:
    """Distance (R + A z) . e - start, m, of a point of a body along a direction of space."""

    point: FloatArray
    along: FloatArray
    start: float

    def __call__(self, y: FloatArray) -> Jet:
        turn = attitude(y[3:])
        second = np.zeros((len(y), len(y)))
        second[3:, 3:] = turn.bend(self.along, self.point)
        value = float((y[:3] + turn.A.dot(self.point)).dot(self.along)) - self.start
        return value, np.concatenate([self.along, self.along.dot(turn.of_body(self.point))]), second


@dataclass(frozen=True, slots=True, eq=False)
class Transmission(SpatialItem):
    """Constraint scale wrap(n_1 q_1 + n_2 q_2) = 0 with one multiplier, of coordinates q_1 of the
    own and q_2 of the other body.

    An angle is known up to whole turns: its factor is an integer (the number of teeth), so that
    these do not matter where the sum is wrapped into -pi to pi.
    """

    own: Turned
    other: Turned | Shifted
    factors: tuple[float, float]
    scale: float
    others: int
    unit: str = "N m"

    @property
    def forces(self) -> int:
        return 1

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        size = m.at.stop
        (a, a1, a2), (b, b1, b2) = self.own(m.y[:size]), self.other(m.y[o : o + self.others])
        n1, n2 = self.factors
        u, lam = n1 * a + n2 * b, m.y[k]
        out.rows[k] = self.scale * (u - 2.0 * pi * round(u / (2.0 * pi)))
        for at, n, first, second in ((slice(0, size), n1, a1, a2),
                                     (slice(o, o + self.others), n2, b1, b2)):
            out.rows[at] += lam * self.scale * n * first
            out.H[at, at] += lam * self.scale * n * second
            out.H[k, at] = out.H[at, k] = self.scale * n * first
