"""Forces by a law of one relative coordinate of two frames: an angle about an axis, or the distance
of two points along an axis of the other frame (notation: items.py).

With the coordinate q, its rate q' and the magnitude L of joint forces that the law reads, the force
f(q, q', L) acts on the left-hand side of the equations as f dq/dy.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import plane_springs
from sparsemor.bodies.frames.attitude import attitude, vector_rates
from sparsemor.bodies.frames.items import EYE
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.bodies.frames.plane_springs import relative_law
from sparsemor.bodies.frames.springs import Along, SpatialRotationalSpring, SpringItem
from sparsemor.core import FloatArray, IntArray
from sparsemor.core.protocols.poses import points_in_space, vectors_in_space

LINEAR, STOP, FRICTION = 0.0, 1.0, 2.0
"""Kinds of law in `plane_springs.relative_law`."""
Numbers = tuple[float, float, float, float, float]
"""A law: its kind and four numbers (`relative_law`)."""


class Coordinate(Protocol):
    """Relative coordinate of two frames in space."""

    def relative(
        self, m: Motion, o: int
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        """Numbers of the rigid coordinates that it depends on (n,), its value, and its first (n,)
        and second (n, n) derivative by them."""
        ...

    def moved(
        self, times: FloatArray, own: Along, other: Along
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values and rates (T,), and force and moment (T, 6) on the own side per unit of force."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Distance:
    """Distance (R + A z - R_o - A_o z_o) . A_o e along an axis e of the other frame, m.

    point (d,) = z, m, in own axes; base (d,) = z_o, m, axis (d,) = e in the other body's axes;
    others: number of its rigid coordinates that are unknowns, 0 if it is at rest at `place`.
    """

    point: FloatArray
    base: FloatArray
    axis: FloatArray
    others: int
    place: FloatArray

    def relative(
        self, m: Motion, o: int
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        y_o = m.y[o : o + self.others] if self.others else self.place
        far, size = attitude(y_o[3:]), m.at.stop
        n, D = far.A.dot(self.axis), m.turn.of_body(self.point)
        gap, at = m.R + m.A.dot(self.point) - y_o[:3], np.arange(size)
        first, second = np.concatenate([n, n.dot(D)]), np.zeros((size, size))
        second[3:, 3:] = m.turn.bend(n, self.point)
        if self.others:
            E = far.of_body(self.axis)
            at = np.concatenate([at, np.arange(o, o + self.others)])
            by = np.hstack([EYE, D, -EYE])
            first = np.concatenate([first, -n, gap.dot(E)])
            whole = np.zeros((len(at), len(at)))
            whole[:size, :size] = second
            whole[: len(by.T), size + 3 :] = by.T.dot(E)
            whole[size + 3 :, : len(by.T)] = E.T.dot(by)
            whole[size + 3 :, size + 3 :] = far.bend(gap, self.axis)
            second = whole
        return at, float(gap.dot(n) - self.base.dot(self.axis)), first, second

    def moved(
        self, times: FloatArray, own: Along, other: Along
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        d, T = len(self.point), len(times)
        n = vectors_in_space(other[0], self.axis)
        gap = points_in_space(own[0], np.broadcast_to(self.point, (len(own[0]), d)))
        gap = gap - other[0][:, :d]
        speed = own[1][:, :d] + vector_rates(*own, self.point) - other[1][:, :d]
        rate = (speed * n).sum(axis=1) + (gap * vector_rates(*other, self.axis)).sum(axis=1)
        value = (gap * n).sum(axis=1) - self.base @ self.axis
        force = np.hstack([np.broadcast_to(n, (T, d)), np.zeros((T, 2 * d - 3))])
        return value, rate, force


@dataclass(frozen=True, slots=True, eq=False)
class PlaneAngle:
    """In the plane: relative angle of two frames since the start, rad; start: at the start."""

    start: float

    def relative(
        self, m: Motion, o: int
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        raise TypeError("in the plane its equations are `plane_springs.relative`")

    def moved(
        self, times: FloatArray, own: Along, other: Along
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        value, rate = (a[:, 2] - b[:, 2] for a, b in zip(own, other, strict=True))
        one = np.zeros((len(times), 3))
        one[:, 2] = 1.0
        return value - self.start, rate, one


@dataclass(frozen=True, slots=True, eq=False)
class Angle:
    """In space: relative angle of two frames about an axis since the start, rad (`spring`), of any
    two turns that nearest to `near`."""

    spring: SpatialRotationalSpring
    near: float

    def relative(
        self, m: Motion, o: int
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        return self.spring.relative(m, o, np.array([self.near]))

    def moved(
        self, times: FloatArray, own: Along, other: Along
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        value, rate, by_turn = self.spring.turned(own, other, np.full(len(times), self.near))
        return value, rate, np.hstack([0 * by_turn, by_turn])


@dataclass(frozen=True, slots=True, eq=False)
class RelativeItem(SpringItem):
    """Force f by a law of a relative coordinate q of the own and the other frame, or of -q.

    law: its numbers; sign: 1 for q, -1 for -q; others: number of the other body's rigid coordinates
    that are unknowns, 0 if it is at rest at `place`; forces: number of joint forces whose magnitude
    the law reads.
    """

    coordinate: Distance | PlaneAngle | Angle
    law: Numbers
    sign: float
    others: int
    place: FloatArray
    forces: int = 0

    def in_plane(self) -> plane.PlanePart:
        c = self.coordinate
        slides = isinstance(c, Distance)
        places = (*c.point.tolist(), *c.axis.tolist(), float(c.base @ c.axis)) if isinstance(
            c, Distance) else (0.0, 0.0, 1.0, 0.0, c.start if isinstance(c, PlaneAngle) else 0.0)
        return plane.PlanePart(plane_springs.relative, (
            *self.law, self.sign, float(slides), float(self.others > 0), float(self.forces),
            *places, *self.place.tolist()))

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        at, q, first, second = self.coordinate.relative(m, o)
        rates, there = m.v[at], slice(k, k + self.forces)
        load = float(np.sqrt(m.y[there].dot(m.y[there])))
        s = self.sign
        f, by_q, by_rate, by_load = relative_law(
            *self.law, s * q, s * float(first.dot(rates)), load)
        # df/dx with q' = first . x' and dx' = c1 dx
        slope = (by_q + m.c1 * by_rate) * first + by_rate * second.dot(rates)
        out.rows[at] += s * f * first
        out.H[np.ix_(at, at)] += np.outer(first, slope) + s * f * second
        if load:
            out.H[at, there] += np.outer(s * by_load * first, m.y[there] / load)

    def along(self, times: FloatArray, own: Along, other: Along) -> tuple[FloatArray, FloatArray]:
        q, rate, unit = self.coordinate.moved(times, own, other)
        s = self.sign
        f = np.array([relative_law(*self.law, s * a, s * b, 0.0)[0]
                      for a, b in zip(q.tolist(), rate.tolist(), strict=True)])
        return f, s * f[:, None] * unit
