"""Force elements between the frames of two bodies, or of a body and the ground: springs, dampers,
motors, stops and friction (notation: frame_items.py).

With a relative coordinate q of the two frames (an angle about an axis, the distance of two points,
or that along an axis of the other frame), its rate q' and the magnitude L of joint forces that the
law reads, the force f(q, q', L, t) acts on the left-hand side of the equations as f dq/dy. It acts
on rigid coordinates alone: a flexible body is attached by a massless frame
(bodies/joints/force_element.py), since its elastic equations have constant matrices.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import plane_springs
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.attitude import Attitude, Free, Jet, attitude, of_angle, vector_rates
from sparsemor.bodies.frames.frame_items import EYE, Item
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.bodies.frames.plane_springs import relative_law
from sparsemor.bodies.frames.space_springs import space_rotational_spring, space_spring
from sparsemor.core import Amplitude, FloatArray, IntArray
from sparsemor.core.protocols.poses import points_in_space, vectors_in_space
from sparsemor.core.protocols.separable import amplitudes_along
from sparsemor.core.protocols.time_function import Held

Along: TypeAlias = tuple[FloatArray, FloatArray]
"""Rigid coordinates of a body at T times and their rates (T, n)."""
LINEAR, STOP, FRICTION = 0.0, 1.0, 2.0
"""Kinds of law in `plane_springs.relative_law`."""
Numbers = tuple[float, float, float, float, float]
"""A law: its kind and four numbers (`relative_law`)."""


def linear(stiffness: float, damping: float) -> Numbers:
    """Law of a spring, N/m or N m/rad, and damper, N s/m or N m s/rad."""
    return LINEAR, stiffness, damping, 0.0, 0.0


class SpringItem(Item, Protocol):
    """Item of a force element, which can be evaluated along given motion."""

    __slots__ = ()

    def along(self, times: FloatArray, own: Along, other: Along) -> tuple[FloatArray, FloatArray]:
        """Force (T,), N or N m, and the force (N) and moment (N m) on the own side (T, 3 d - 3), in
        space axes with the sign of the left-hand sides of the equations."""
        ...


# ---------------------------------------------------------------------- relative coordinates

@dataclass(frozen=True, slots=True, eq=False)
class Coordinate:
    """Relative coordinate of two frames (a length, m, or an angle, rad). others: number of the
    other body's rigid coordinates that are unknowns, 0 if it is at rest at `place`, its pose at the
    start.

    Angles in space are known up to two turns: of these it is the one nearest to `near`, rad. o:
    first coordinate of the other body in y. `Along`: rigid coordinates (T, n) at T times, and their
    rates.
    """

    others: int
    place: FloatArray

    @abstractmethod
    def relative(
        self, m: Motion, o: int, near: float
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        """In space: numbers in y of the rigid coordinates that it depends on (n,), its value, and
        its first (n,) and second (n, n) derivative by them."""

    @abstractmethod
    def moved(
        self, own: Along, other: Along, near: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values and rates (T,), and force and moment (T, 3 d - 3) on the own side per unit of
        force; near (T,): as in `relative`."""

    def far(self, m: Motion, o: int) -> FloatArray:
        """Rigid coordinates of the other body."""
        return m.y[o : o + self.others] if self.others else self.place


@dataclass(frozen=True, slots=True, eq=False)
class Length(Coordinate):
    """Distance |R + A z - R_o - A_o z_o| of two points, m: own point (d,) = z and base (d,) = z_o
    of the other body, m, each in the axes of its body. relative: by the present motion in space,
    moved: along given motion; near: not used, as a length is not ambiguous."""

    point: FloatArray
    base: FloatArray

    def relative(
        self, m: Motion, o: int, near: float
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        """Numbers of the rigid coordinates in y, |gap| with gap = R + A z - R_o - A_o z_o (z =
        `point`, z_o = `base`), its gradient and second derivatives; the other body's coordinates
        follow the own ones, if unknown. near: for angles alone. of_body(b), bend(f, b): derivative
        of A b and second one of f . A b by the attitude."""
        y_o, size = self.far(m, o), m.at.stop
        far, D = attitude(y_o[3:]), m.turn.of_body(self.point)
        gap = m.R + m.A.dot(self.point) - y_o[:3] - far.A.dot(self.base)
        gap_by, at = np.hstack([EYE, D]), np.arange(size)
        if self.others:
            gap_by = np.hstack([gap_by, -EYE, -far.of_body(self.base)])
            at = np.concatenate([at, np.arange(o, o + self.others)])
        length = float(np.sqrt(gap.dot(gap)))
        n = gap / length
        first = n.dot(gap_by)
        second = (gap_by.T.dot(gap_by) - np.outer(first, first)) / length
        second[3:size, 3:size] += m.turn.bend(n, self.point)
        if self.others:
            second[size + 3 :, size + 3 :] -= far.bend(n, self.base)
        return at, length, first, second

    def moved(
        self, own: Along, other: Along, near: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The length, its rate (T,), and as wrench per unit of force (T, 3 d - 3) the direction n
        of the gap, without moment. own, other: rigid coordinates (T, n) and their rates."""
        d = len(self.point)
        gap = _placed(own[0], self.point) - _placed(other[0], self.base)
        speed = (own[1][:, :d] + vector_rates(*own, self.point)
                 - other[1][:, :d] - vector_rates(*other, self.base))
        length = np.linalg.norm(gap, axis=1)
        n = gap / length[:, None]
        return length, (n * speed).sum(axis=1), np.pad(n, ((0, 0), (0, 2 * d - 3)))


@dataclass(frozen=True, slots=True, eq=False)
class Distance(Coordinate):
    """Distance (R + A z - R_o - A_o z_o) . A_o e along an axis e of the other frame, m.

    point (d,) = z, m, in own axes; base (d,) = z_o, m, axis (d,) = e in the other body's axes.
    """

    point: FloatArray
    base: FloatArray
    axis: FloatArray

    def relative(
        self, m: Motion, o: int, near: float
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        """Numbers of the rigid coordinates in y, the distance (R + A z - R_o - A_o z_o) . n, n =
        A_o e, its gradient and second derivatives; the other body's coordinates, from o on, follow
        the own ones, if unknown. near: for angles alone. of_body(b), bend(f, b): derivative of A b
        and second one of f . A b by the attitude."""
        y_o, size = self.far(m, o), m.at.stop
        far = attitude(y_o[3:])
        n, D = far.A.dot(self.axis), m.turn.of_body(self.point)
        # the distance is gap . n - base . axis; D, E: derivatives of A z and n by the attitudes
        gap, at = m.R + m.A.dot(self.point) - y_o[:3], np.arange(size)
        first, second = np.concatenate([n, n.dot(D)]), np.zeros((size, size))
        second[3:, 3:] = m.turn.bend(n, self.point)
        if self.others:
            E = far.of_body(self.axis)
            at = np.concatenate([at, np.arange(o, o + self.others)])
            gap_by = np.hstack([EYE, D, -EYE])  # by all but the other's attitude, from size + 3 on
            first = np.concatenate([first, -n, gap.dot(E)])
            whole = np.zeros((len(at), len(at)))
            whole[:size, :size] = second
            whole[: size + 3, size + 3 :] = gap_by.T.dot(E)
            whole[size + 3 :, : size + 3] = E.T.dot(gap_by)
            whole[size + 3 :, size + 3 :] = far.bend(gap, self.axis)
            second = whole
        return at, float(gap.dot(n) - self.base.dot(self.axis)), first, second

    def moved(
        self, own: Along, other: Along, near: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The distance, its rate, and as force per unit the axis n = A_o e, without moment."""
        d, T = len(self.point), len(near)
        n = vectors_in_space(other[0], self.axis)
        gap = _placed(own[0], self.point) - other[0][:, :d]
        speed = own[1][:, :d] + vector_rates(*own, self.point) - other[1][:, :d]
        rate = (speed * n).sum(axis=1) + (gap * vector_rates(*other, self.axis)).sum(axis=1)
        value = (gap * n).sum(axis=1) - self.base @ self.axis
        return value, rate, np.pad(np.broadcast_to(n, (T, d)), ((0, 0), (0, 2 * d - 3)))


def _placed(pose: FloatArray, z: FloatArray) -> FloatArray:
    """(T, d) positions in space of a point z (d,) of a body, m."""
    return points_in_space(pose, np.broadcast_to(z, (len(pose), len(z))))


@dataclass(frozen=True, slots=True, eq=False)
class PlaneAngle(Coordinate):
    """In the plane: relative angle of two frames since the start, rad: angle 2 of the own rigid
    coordinates minus that of the other ones, minus `start`, this difference at the start. An angle
    in the plane counts all turns, so `near` is not needed."""

    start: float

    def relative(
        self, m: Motion, o: int, near: float
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        raise TypeError("in the plane its equations are those of plane_springs.py")

    def moved(
        self, own: Along, other: Along, near: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        value, rate = (a[:, 2] - b[:, 2] for a, b in zip(own, other, strict=True))
        one = np.zeros((len(near), 3))
        one[:, 2] = 1.0
        return value - self.start, rate, one


@dataclass(frozen=True, slots=True, eq=False)
class Angle(Coordinate):
    """In space: relative angle phi of two frames about an axis since the start, rad: phi = atan2(A
    d . A_o e_2, A d . A_o e_1), plus whole turns (`counted`).

    own (3,) = d in own axes; first, second (3,) = e_1, e_2 in the other body's axes; start (4,) or
    (1,): own attitude at the start.
    """

    own: FloatArray
    first: FloatArray
    second: FloatArray
    start: FloatArray

    def _at_start(self) -> tuple[FloatArray, ...]:
        """Relative quaternion r_0 at the start, and (0, n) r_0 with the axis n."""
        p, f = (_quaternions(q[None])[0] for q in (self.start, self.place[3:]))
        r = rot.product(rot.conjugate(f), p)
        return r, rot.product(np.array([0.0, *rot.cross(self.first, self.second)]), r)

    def nearly(self, own: FloatArray, other: FloatArray, near: FloatArray) -> FloatArray:
        """Relative angles (T,) since the start, rad, from the attitudes (T, 4) or (T, 1) of both;
        exact if they turn about the axis alone.

        Where both turn about the z axis alone, their angles count all turns. The quaternions p and
        -p have the same A, but p is continuous in time: the relative quaternion r = f* p of p and f
        of the other body is that of the start, turned by phi: r = (cos(phi / 2), n sin(phi / 2))
        r_0, which determines phi but for 4 pi: it is the angle nearest to `near` (T,), since a
        spring is not deflected by more than 2 pi. _at_start: the quaternions r_0 and (0, n) r_0, on
        which r has the components cos and sin of phi / 2.
        """
        if own.shape[1] == 1 and (other.shape[1] == 1 or not self.others):
            about_z = float(rot.cross(self.first, self.second)[2])  # 1 or -1, the axis' direction
            angle = own - self.start
            if self.others:
                angle = angle - (other - self.place[3:])
            return np.asarray(about_z * angle[:, 0])
        p, f = _quaternions(own), _quaternions(other)
        c, s = ((p * rot.products(f, r)).sum(axis=1) for r in self._at_start())
        phi = 2.0 * np.arctan2(s, c)
        return np.asarray(phi + 4.0 * np.pi * np.floor((near - phi) / (4.0 * np.pi) + 0.5))

    def counted(
        self, raw: FloatArray, own: FloatArray, other: FloatArray, near: FloatArray
    ) -> FloatArray:
        """Angles (T,) between -pi and pi, `raw`, plus the whole turns of `nearly`."""
        phi = self.nearly(own, other, near)
        return np.asarray(raw + 2.0 * np.pi * np.floor((phi - raw) / (2.0 * np.pi) + 0.5))

    def relative(
        self, m: Motion, o: int, near: float
    ) -> tuple[IntArray, float, FloatArray, FloatArray]:
        """Numbers in y of the attitude coordinates of both bodies, the angle, rad, between a
        direction of the own side and two of the other, with whole turns counted near `near`, rad,
        and its first and second derivatives by them. o: first coordinate of the other body."""
        y_o = self.far(m, o)
        far, at = attitude(y_o[3:]), np.arange(m.at.start, m.at.stop)
        if self.others:
            at = np.concatenate([at, np.arange(o + 3, o + self.others)])
        raw, first, second = of_angle(
            self._cosine(m, far, self.first), self._cosine(m, far, self.second))
        phi = self.counted(np.array([raw]), m.y[None, m.at], y_o[None, 3:], np.array([near]))
        return at, float(phi[0]), first, second

    def _cosine(self, m: Motion, far: Attitude, e: FloatArray) -> Jet:
        """A d . A_o e with its derivatives by the attitude coordinates of both."""
        d, f, D = m.A.dot(self.own), far.A.dot(e), m.turn.of_body(self.own)
        first, second = f.dot(D), m.turn.bend(f, self.own)
        if self.others:
            E = far.of_body(e)
            first = np.concatenate([first, d.dot(E)])
            second = np.block([[second, D.T.dot(E)], [E.T.dot(D), far.bend(d, e)]])
        return float(d.dot(f)), first, second

    def moved(
        self, own: Along, other: Along, near: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The angle (T,), its rate, and per unit of moment the force, 0, and moment (T, 6), its
        derivative by a small rotation of the own body: with c = d . f_1, s = d . f_2, all in space
        axes, it is d x (c f_2 - s f_1) / (c^2 + s^2). own, other: rigid coordinates and rates."""
        d, d_rate = vectors_in_space(own[0], self.own), vector_rates(*own, self.own)
        f, cosines, rates = [], [], []
        for e in (self.first, self.second):
            f.append(vectors_in_space(other[0], e))
            cosines.append((d * f[-1]).sum(axis=1))
            rates.append((d_rate * f[-1] + d * vector_rates(*other, e)).sum(axis=1))
        (c, s), (c_rate, s_rate) = cosines, rates
        size = c * c + s * s
        phi = self.counted(np.arctan2(s, c), own[0][:, 3:], other[0][:, 3:], near)
        moment = np.cross(d, c[:, None] * f[1] - s[:, None] * f[0]) / size[:, None]
        return phi, (c * s_rate - s * c_rate) / size, np.pad(moment, ((0, 0), (3, 0)))


def _quaternions(q: FloatArray) -> FloatArray:
    """(T, 4) quaternions of attitudes (T, 4), or (T, 1) angles about z."""
    if q.shape[1] == Free.size:
        return q
    half, none = 0.5 * q[:, 0], np.zeros(len(q))
    return np.stack([np.cos(half), none, none, np.sin(half)], axis=1)


# ---------------------------------------------------------------------- forces

@dataclass(frozen=True, slots=True, eq=False)
class RelativeItem(SpringItem):
    """Force f by a law of a relative coordinate q of the own and the other frame, or of -q, plus
    drive(t), N or N m.

    law: its numbers, of a spring by q - relaxed(t); sign: 1 for q, -1 for -q; forces: number of
    joint forces whose magnitude the law reads; near: angle, rad, to which that in space is nearest
    among those that differ by two turns, where `relaxed` is not given.
    """

    coordinate: Coordinate
    law: Numbers
    sign: float = 1.0
    forces: int = 0
    drive: Amplitude | None = None
    relaxed: Amplitude | None = None
    near: float = 0.0

    @property
    def others(self) -> int:  # type: ignore[override]
        return self.coordinate.others

    def near_at(self, times: FloatArray) -> FloatArray:
        """Angles (T,), rad, to which those at times (T,), s, are nearest: of a spring those without
        deflection."""
        return np.full(len(times), self.near) if self.relaxed is None else (
            amplitudes_along((self.relaxed,), times)[:, 0])

    def in_plane(self) -> plane.PlanePart:
        """Its numbers in the orders of the functions of plane_springs.py, which have their legends;
        `law`: its kind, then stiffness and damping for the kind `LINEAR`; place: pose of a body at
        rest, whose coordinates are no unknowns; zero: value of the coordinate that counts as
        zero."""
        c, drive, moves = self.coordinate, self.drive or Held(0.0), float(self.others > 0)
        place = c.place.tolist() if not self.others else [0.0] * 3
        stiffness_and_damping = self.law[1:3]  # of a law of the kind `LINEAR`, as of all lengths
        if isinstance(c, Length):
            return plane.PlanePart(plane_springs.spring, (
                *c.point.tolist(), *c.base.tolist(), *stiffness_and_damping, moves, *place), drive)
        if isinstance(c, PlaneAngle) and self.law[0] == LINEAR:
            return plane.PlanePart(plane_springs.rotational_spring, (
                *stiffness_and_damping, moves, c.start + place[2]), drive)
        point, axis, zero = [0.0, 0.0], [1.0, 0.0], 0.0
        if isinstance(c, Distance):
            point, axis, zero = c.point.tolist(), c.axis.tolist(), float(c.base @ c.axis)
        elif isinstance(c, PlaneAngle):
            zero = c.start
        return plane.PlanePart(plane_springs.relative, (
            *self.law, self.sign, float(isinstance(c, Distance)), moves, float(self.forces),
            *point, *axis, zero, *place))

    def in_space(self) -> tuple[spatial.SpacePart, ...] | None:
        """Its numbers in the orders of the functions of space_springs.py, which have their legends;
        points and directions of a body at rest are given in space axes. None for what is not
        compiled: distances along an axis, and angles with stops or friction. With a relaxed angle
        there are two parts, spring and drive, as a part has one amplitude."""
        c, drive = self.coordinate, self.drive or Held(0.0)
        attitudes = float(max(self.others - 3, 0))  # unknown attitude coordinates of the other body
        A, place = np.eye(3), np.zeros(3)
        if not self.others:
            A, place = attitude(c.place[3:]).A, c.place[:3]
        stiffness, damping = self.law[1:3]  # of a law of the kind `LINEAR`, as of all lengths
        if isinstance(c, Length):
            base = place + A @ c.base
            return (spatial.SpacePart(space_spring, (
                *c.point.tolist(), *base.tolist(), stiffness, damping, attitudes), drive),)
        if not isinstance(c, Angle) or self.law[0] != LINEAR:
            return None
        # pair: quaternions r_0 and (0, n) r_0 (`Angle.nearly`); angle: difference of the attitudes
        # at the start, for two frames that turn about z alone, where these are angles
        pair, angle = c._at_start(), float(c.start[-1])
        if self.others:
            angle -= float(c.place[-1])
        else:
            pair = tuple(rot.products(_quaternions(c.place[None, 3:]), r)[0] for r in pair)

        def part(k: float, damping: float, g_relaxes: float, g: Amplitude) -> spatial.SpacePart:
            """Spring with the amplitude g, its relaxed angle (g_relaxes 1) or its moment (0)."""
            return spatial.SpacePart(space_rotational_spring, (
                *c.own.tolist(), *(A @ c.first).tolist(), *(A @ c.second).tolist(), k, damping,
                attitudes, *pair[0].tolist(), *pair[1].tolist(), angle, g_relaxes), g)

        if self.relaxed is None:
            return (part(stiffness, damping, 0.0, drive),)
        return part(stiffness, damping, 1.0, self.relaxed), part(0.0, 0.0, 0.0, drive)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds the force f(s q, s q', |joint forces|) of the law on the relative coordinate q,
        along its gradient `first`, plus the drive, with derivatives H = d rows / dy; s: its sign, 1
        or -1; at: numbers in y of the coordinates of q; o, k: first coordinate of the other body,
        first of the joint forces that the law reads. j: not used, it has no functionals."""
        near, s = self.near if self.relaxed is None else self.relaxed(m.t), self.sign
        at, q, first, second = self.coordinate.relative(m, o, near)
        rates, multipliers = m.v[at], slice(k, k + self.forces)
        load = float(np.sqrt(m.y[multipliers].dot(m.y[multipliers])))
        if self.relaxed is not None:
            q -= near
        f, by_q, by_rate, by_load = relative_law(
            *self.law, s * q, s * float(first.dot(rates)), load)
        f *= s
        if self.drive is not None:
            f += self.drive(m.t)
        # df/dx with q' = first . x' and dx' = c1 dx
        slope = (by_q + m.c1 * by_rate) * first + by_rate * second.dot(rates)
        out.rows[at] += f * first
        out.H[np.ix_(at, at)] += np.outer(first, slope) + f * second
        if load:
            out.H[at, multipliers] += np.outer(s * by_load * first, m.y[multipliers] / load)

    def moved(
        self, times: FloatArray, own: Along, other: Along
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values of the coordinate, rates and wrenches (`Coordinate.moved`) at times (T,), s."""
        return self.coordinate.moved(own, other, self.near_at(times))

    def along(self, times: FloatArray, own: Along, other: Along) -> tuple[FloatArray, FloatArray]:
        """As in `SpringItem`; the law reads no joint forces here, which no motion tells."""
        q, rate, unit = self.moved(times, own, other)
        s = self.sign
        if self.relaxed is not None:
            q = q - self.near_at(times)
        f = np.array([relative_law(*self.law, s * a, s * b, 0.0)[0]
                      for a, b in zip(q.tolist(), rate.tolist(), strict=True)])
        if self.drive is not None:
            f = f + s * amplitudes_along((self.drive,), times)[:, 0]
        return f, s * f[:, None] * unit
