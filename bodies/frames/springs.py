"""Springs with dampers and drives between the frames of two bodies, or of a body and the ground
(notation: items.py).

They act on rigid coordinates alone: a flexible body is attached by a massless frame
(bodies/joints/force_element.py), since its elastic equations have constant matrices.
"""

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import plane_springs
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.attitude import Attitude, Free, attitude, vector_rates
from sparsemor.bodies.frames.items import EYE, Item
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.bodies.frames.space_springs import space_rotational_spring, space_spring
from sparsemor.core import Amplitude, FloatArray, IntArray
from sparsemor.core.protocols.poses import points_in_space, vectors_in_space
from sparsemor.core.protocols.separable import amplitudes_along

Along: TypeAlias = tuple[FloatArray, FloatArray]
"""Rigid coordinates of a body at T times and their rates (T, n)."""


class SpringItem(Item, Protocol):
    """Item of a force element, which can be evaluated along given motion."""

    __slots__ = ()

    def along(self, times: FloatArray, own: Along, other: Along) -> tuple[FloatArray, FloatArray]:
        """Force (T,), N or N m, and the force (N) and moment (N m) on the own side (T, 3 d - 3), in
        space axes with the sign of the left-hand sides of the equations."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Spring(SpringItem):
    """Force stiffness l + damping l' + drive(t), N, along the line between two points at the
    distance l; positive pulls them together.

    point, base (d,): own point and that of the other body, m, in their axes; stiffness, N/m;
    damping, N s/m; others: number of the other body's rigid coordinates that are unknowns, 0 if it
    is at rest at `place`.
    """

    point: FloatArray
    base: FloatArray
    stiffness: float
    damping: float
    drive: Amplitude
    others: int
    place: FloatArray

    def in_plane(self) -> plane.PlanePart:
        place = self.place.tolist() if not self.others else [0.0] * 3
        return plane.PlanePart(plane_springs.spring, (
            *self.point.tolist(), *self.base.tolist(), self.stiffness, self.damping,
            float(self.others > 0), *place), self.drive)

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        base = self.base if self.others else (
            self.place[:3] + attitude(self.place[3:]).A @ self.base)
        return (spatial.SpacePart(space_spring, (
            *self.point.tolist(), *base.tolist(), self.stiffness, self.damping,
            float(max(self.others - 3, 0))), self.drive),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        size, there = m.at.stop, slice(o, o + self.others)
        y_o = m.y[there] if self.others else self.place
        far, q1 = attitude(y_o[3:]), m.v[m.at]
        gap = m.R + m.A.dot(self.point) - y_o[:3] - far.A.dot(self.base)
        # derivatives of gap and, at fixed rates, of its rate by own and the other's coordinates
        by = np.hstack([EYE, m.turn.of_body(self.point)])
        speed = m.v[:3] + by[:, 3:].dot(q1)
        by_rate = np.hstack([np.zeros((3, 3)), _turned(m.turn, q1, self.point)])
        at = np.arange(size)
        if self.others:
            q2, D = m.v[there][3:], far.of_body(self.base)
            speed = speed - m.v[there][:3] - D.dot(q2)
            by = np.hstack([by, -EYE, -D])
            by_rate = np.hstack([by_rate, np.zeros((3, 3)), -_turned(far, q2, self.base)])
            at = np.concatenate([at, np.arange(there.start, there.stop)])
        length = float(np.sqrt(gap.dot(gap)))
        n = gap / length
        rate = float(n.dot(speed))
        f = self.stiffness * length + self.damping * rate + self.drive(m.t)
        along = n.dot(by)
        of_f = self.stiffness * along + self.damping * (
            (speed - rate * n).dot(by) / length + n.dot(m.c1 * by + by_rate))
        # dF = n df + f dn, with dn = (1 - n n^T) dgap / length
        d = np.outer(n, of_f) + f / length * (by - np.outer(n, along))
        F = f * n
        out.rows[at] += F.dot(by)
        out.H[np.ix_(at, at)] += by.T.dot(d)
        out.H[m.at, m.at] += m.turn.bend(F, self.point)
        if self.others:
            turn = slice(there.start + 3, there.stop)
            out.H[turn, turn] -= far.bend(F, self.base)

    def along(self, times: FloatArray, own: Along, other: Along) -> tuple[FloatArray, FloatArray]:
        d = len(self.point)
        gap = _placed(own[0], self.point) - _placed(other[0], self.base)
        speed = (own[1][:, :d] + vector_rates(*own, self.point)
                 - other[1][:, :d] - vector_rates(*other, self.base))
        length = np.linalg.norm(gap, axis=1)
        n = gap / length[:, None]
        f = (self.stiffness * length + self.damping * (n * speed).sum(axis=1)
             + amplitudes_along((self.drive,), times)[:, 0])
        return f, np.hstack([f[:, None] * n, np.zeros((len(times), 2 * d - 3))])


def _placed(pose: FloatArray, z: FloatArray) -> FloatArray:
    return points_in_space(pose, np.broadcast_to(z, (len(pose), len(z))))


def _turned(turn: Attitude, rates: FloatArray, b: FloatArray) -> FloatArray:
    """(3, n) derivative of (d (A b) / dq) rates by the n attitude coordinates q."""
    if isinstance(turn, Free):  # A b is quadratic in the quaternion
        return rot.of_body_vector(rot.to_space(rates), b)
    return np.asarray(-rates[0] * turn.A.dot([[b[0]], [b[1]], [0.0]]))


def _quaternions(q: FloatArray) -> FloatArray:
    """(T, 4) quaternions of attitudes (T, 4), or (T, 1) angles about z."""
    if q.shape[1] == Free.size:
        return q
    half, none = 0.5 * q[:, 0], np.zeros(len(q))
    return np.stack([np.cos(half), none, none, np.sin(half)], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class RotationalSpringItem(SpringItem):
    """In the plane: moment stiffness phi + damping phi' + drive(t), N m, against the relative angle
    phi, rad, of the own and the other frame.

    stiffness, N m/rad; damping, N m s/rad; others: 3, or 0 where the other body is at rest at
    `angle`, rad.
    """

    stiffness: float
    damping: float
    drive: Amplitude
    others: int
    angle: float

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane_springs.rotational_spring, (
            self.stiffness, self.damping, float(self.others > 0), self.angle), self.drive)

    def along(self, times: FloatArray, own: Along, other: Along) -> tuple[FloatArray, FloatArray]:
        phi, rate = (a[:, 2] - b[:, 2] for a, b in zip(own, other, strict=True))
        M = (self.stiffness * phi + self.damping * rate
             + amplitudes_along((self.drive,), times)[:, 0])
        return M, np.stack([0 * M, 0 * M, M], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class SpatialRotationalSpring(SpringItem):
    """In space: moment stiffness (phi - relaxed(t)) + damping phi' + drive(t), N m, against the
    relative angle phi, rad, of the own and the other frame about an axis: phi = atan2(A d . A_o
    e_2, A d . A_o e_1), plus whole turns (`counted`).

    own (3,) = d in own axes; first, second (3,) = e_1, e_2 in the other body's axes; others: number
    of its rigid coordinates that are unknowns, 0 if it is at rest at `place`; start (4,) or (1,):
    own attitude at the start, `place`: pose of the other body there; relaxed: angle without
    deflection, rad, None for zero.
    """

    own: FloatArray
    first: FloatArray
    second: FloatArray
    stiffness: float
    damping: float
    drive: Amplitude
    others: int
    place: FloatArray
    start: FloatArray
    relaxed: Amplitude | None = None

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        A, place = np.eye(3) if self.others else attitude(self.place[3:]).A, self.place[None, 3:]
        pair, angle = self._at_start(), float(self.start[-1])
        if self.others:
            angle -= float(self.place[-1])
        else:
            pair = tuple(rot.products(_quaternions(place), r)[0] for r in pair)

        def part(k: float, c: float, relaxed: float, g: Amplitude) -> spatial.SpacePart:
            return spatial.SpacePart(space_rotational_spring, (
                *self.own.tolist(), *(A @ self.first).tolist(), *(A @ self.second).tolist(), k, c,
                float(max(self.others - 3, 0)), *pair[0].tolist(), *pair[1].tolist(), angle,
                relaxed), g)

        if self.relaxed is None:
            return (part(self.stiffness, self.damping, 0.0, self.drive),)
        return (part(self.stiffness, self.damping, 1.0, self.relaxed),
                part(0.0, 0.0, 0.0, self.drive))

    def _at_start(self) -> tuple[FloatArray, ...]:
        """Relative quaternion r_0 at the start, and (0, n) r_0 with the axis n."""
        p, f = (_quaternions(q[None])[0] for q in (self.start, self.place[3:]))
        r = rot.product(rot.conjugate(f), p)
        return r, rot.product(np.array([0.0, *rot.cross(self.first, self.second)]), r)

    def nearly(self, own: FloatArray, other: FloatArray, relaxed: FloatArray) -> FloatArray:
        """Relative angles (T,) since the start, rad, from the attitudes (T, 4) or (T, 1) of both;
        exact if they turn about the axis alone. relaxed (T,): angles without deflection.

        Where both turn about the z axis alone, their angles count all turns. The quaternions p and
        -p have the same A, but p is continuous in time: the relative quaternion r = f* p of p and f
        of the other body is that of the start, turned by phi: r = (cos(phi / 2), n sin(phi / 2))
        r_0, which determines phi but for 4 pi. A spring is not deflected by more than 2 pi: it is
        the angle nearest to the relaxed one.
        """
        if own.shape[1] == 1 and (other.shape[1] == 1 or not self.others):
            about = float(rot.cross(self.first, self.second)[2])
            turned = own - self.start
            if self.others:
                turned = turned - (other - self.place[3:])
            return np.asarray(about * turned[:, 0])
        p, f = _quaternions(own), _quaternions(other)
        c, s = ((p * rot.products(f, r)).sum(axis=1) for r in self._at_start())
        phi = 2.0 * np.arctan2(s, c)
        return np.asarray(phi + 4.0 * np.pi * np.floor((relaxed - phi) / (4.0 * np.pi) + 0.5))

    def relaxed_at(self, times: FloatArray) -> FloatArray:
        """Angles (T,) without deflection at times (T,), s."""
        if self.relaxed is None:
            return np.zeros(len(times))
        return amplitudes_along((self.relaxed,), times)[:, 0]

    def counted(
        self, raw: FloatArray, own: FloatArray, other: FloatArray, relaxed: FloatArray
    ) -> FloatArray:
        """Angles (T,) between -pi and pi, `raw`, plus the whole turns of `nearly`."""
        near = self.nearly(own, other, relaxed)
        return np.asarray(raw + 2.0 * np.pi * np.floor((near - raw) / (2.0 * np.pi) + 0.5))

    def relative(
        self, m: Motion, o: int, relaxed: FloatArray
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        """Numbers of the attitude coordinates of both bodies (n,), the relative angle, rad, and its
        first (n,) and second (n, n) derivative by them; relaxed (1,): angle without deflection."""
        far = attitude((m.y[o : o + self.others] if self.others else self.place)[3:])
        at = np.arange(m.at.start, m.at.stop)
        if self.others:
            at = np.concatenate([at, np.arange(o + 3, o + self.others)])
        c, c1, c2 = self._cosine(m, far, self.first)
        s, s1, s2 = self._cosine(m, far, self.second)
        size = c * c + s * s
        along = (c * s1 - s * c1) / size  # derivative of phi
        bend = (np.outer(s1, c1) - np.outer(c1, s1) + c * s2 - s * c2) / size - np.outer(
            along, 2.0 * (c * c1 + s * s1) / size)
        phi = self.counted(np.arctan2([s], [c]), m.y[None, m.at], m.y[
            None, o + 3 : o + self.others] if self.others else self.place[None, 3:], relaxed)
        return at, float(phi[0]), along, bend

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        relaxed = self.relaxed_at(np.array([m.t]))
        at, phi, along, bend = self.relative(m, o, relaxed)
        rates = m.v[at]
        moment = (self.stiffness * (phi - float(relaxed[0])) + self.damping * float(
            along.dot(rates)) + self.drive(m.t))
        slope = (self.stiffness + self.damping * m.c1) * along + self.damping * bend.dot(rates)
        out.rows[at] += moment * along
        out.H[np.ix_(at, at)] += np.outer(along, slope) + moment * bend

    def turned(
        self, own: Along, other: Along, relaxed: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Relative angles (T,) along given motion, their rates, and moments (T, 3) on the own side
        per unit of moment."""
        d, e = vectors_in_space(own[0], self.own), (self.first, self.second)
        f = [vectors_in_space(other[0], x) for x in e]
        c, s = ((d * x).sum(axis=1) for x in f)
        turning = vector_rates(*own, self.own)
        c1, s1 = ((turning * x + d * vector_rates(*other, y)).sum(axis=1)
                  for x, y in zip(f, e, strict=True))
        size = c * c + s * s
        phi = self.counted(np.arctan2(s, c), own[0][:, 3:], other[0][:, 3:], relaxed)
        by_turn = np.cross(d, c[:, None] * f[1] - s[:, None] * f[0]) / size[:, None]
        return phi, (c * s1 - s * c1) / size, by_turn

    def along(self, times: FloatArray, own: Along, other: Along) -> tuple[FloatArray, FloatArray]:
        relaxed = self.relaxed_at(times)
        phi, rate, by_turn = self.turned(own, other, relaxed)
        M = (self.stiffness * (phi - relaxed) + self.damping * rate
             + amplitudes_along((self.drive,), times)[:, 0])
        return M, np.hstack([0 * by_turn, M[:, None] * by_turn])

    def _cosine(
        self, m: Motion, far: Attitude, e: FloatArray
    ) -> tuple[float, FloatArray, FloatArray]:
        """A d . A_o e with first and second derivatives by the attitude coordinates of both."""
        d, f, D = m.A.dot(self.own), far.A.dot(e), m.turn.of_body(self.own)
        first, second = f.dot(D), m.turn.bend(f, self.own)
        if self.others:
            E = far.of_body(e)
            first = np.concatenate([first, d.dot(E)])
            second = np.block([[second, D.T.dot(E)], [E.T.dot(D), far.bend(d, e)]])
        return float(d.dot(f)), first, second
