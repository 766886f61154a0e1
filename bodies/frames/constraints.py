"""Constraints of frames: unit length of the four Euler parameters of one in space; between two
frames points that slide and, in space, directions that stay perpendicular, gears and racks.

Sliding points and perpendicular directions are products of coordinates of both bodies. They are
evaluated with the equations of one of them (the own body, which may be flexible) and read the rigid
coordinates of the other; the ground is another body at rest at the origin. All derivatives follow
from the potential sum lambda_k g_k, so the matrix of rigid coordinates and multipliers stays
symmetric.
"""

from dataclasses import dataclass, field, replace
from math import pi

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.attitude import Attitude, Jet, attitude, of_angle
from sparsemor.bodies.frames.frame_items import AXES, RigidItem, SpatialItem, Wrench
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import Amplitude, FloatArray
from sparsemor.core.protocols.poses import points_in_space, vectors_in_space
from sparsemor.core.protocols.time_function import time_derivatives

GROUND = {2: np.zeros(3), 3: np.array([0.0, 0, 0, 1, 0, 0, 0])}
"""Dimension -> rigid coordinates of the ground."""


@dataclass(frozen=True, slots=True, eq=False)
class UnitLength(RigidItem):
    """Unit length of the Euler parameters p (4,), the attitude of a body in space: constraint
    (p.p - 1)/2 = 0 with a multiplier, N m. m.y: rigid coordinates and multipliers, with p at m.at;
    others, forces: numbers of coordinates of another body and of multipliers."""

    others = 0
    forces = 1

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(spatial.unit_length, ()),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds the constraint in row k, and its multiplier mu times its derivative p; H: derivative
        of the rows by y, `diagonal`: a view of its diagonal."""
        mu, p = m.y[k], m.y[m.at]
        out.rows[m.at] += mu * p
        out.rows[k] = 0.5 * (p.dot(p) - 1.0)
        out.H[m.at, k] = out.H[k, m.at] = p
        out.diagonal[m.at] += mu


@dataclass(frozen=True, slots=True, eq=False)
class Facing(SpatialItem):
    """Perpendicularity constraints g_k = (A d_k) . (A_o e_k): `own` = d (l, 3) in own axes, `other`
    = e (l, 3) in the other body's.

    others: number of the other body's rigid coordinates that are unknowns, 0 if it is at rest at
    `place` (7 or 4,). turns: d rotates with the mean rotation of a flexible set of nodes, (3,) rad,
    in own axes; turned: that rotation in the shape from which displacements are measured. turn:
    angle (rad) by which e is rotated about `axis` (3,) of the other body, a function of time.
    """

    own: FloatArray
    other: FloatArray
    others: int = 0
    place: FloatArray = field(default_factory=lambda: GROUND[3])
    turns: bool = False
    turned: FloatArray = field(default_factory=lambda: np.zeros(3))
    turn: Amplitude | None = None
    axis: FloatArray | None = None

    @property
    def directions(self) -> int:
        return 3 if self.turns else 0

    @property
    def forces(self) -> int:
        return len(self.own)

    @property
    def reactions(self) -> tuple[tuple[str, str], ...]:
        return (("moment", "N m"),) * self.forces

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(f"joint {source} turn {a}" for a in AXES) if self.turns else ()

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Facing":
        return replace(self, turned=self.turned + s) if self.turns else self

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        """One constraint (A d) . (A_o e) = 0 for each pair d, e of `own`, `other`; e of a body at
        rest (`others` 0), with the pose `place`, is given in space axes. The amplitude is the
        angle, rad, by which e is rotated about `axis`; `turned`: initial mean rotation of d, with
        `turns`.
        """
        amplitude, axis = None, np.zeros(3)
        if self.turn is not None and self.axis is not None:
            amplitude, axis = self.turn, self.axis / np.linalg.norm(self.axis)
        to_given = np.eye(3) if self.others else attitude(self.place[3:]).A
        parts = []
        for row, (d, e) in enumerate(zip(self.own, self.other, strict=True)):
            numbers = spatial.constraint_numbers(
                d, to_given @ e, others=self.others, kind=spatial.DIRECTION if self.turns else 0,
                turned=self.turned, axis=to_given @ axis)
            parts.append(spatial.SpacePart(spatial.constraint, numbers, amplitude, row))
        return tuple(parts)

    def faces(self, t: float) -> FloatArray:
        """(l, 3) directions e at time t, s."""
        if self.turn is None or self.axis is None:
            return self.other
        A = rot.rotation(rot.about(self.axis.tolist(), self.turn(t)))
        return np.asarray(self.other.dot(A.T))

    def time_derivative(self, order: int, t: float, h: float) -> "Facing | None":
        """The constraint's partial time derivative: e' = alpha' n x e or e'' = alpha'' n x e +
        alpha'^2 n x (n x e), n the axis."""
        if self.turn is None or self.axis is None:
            return None
        rate, curvature = time_derivatives(self.turn, t, h)
        n = rot.skew(self.axis / np.linalg.norm(self.axis))
        D = rate * n if order == 1 else curvature * n + rate**2 * n.dot(n)
        return replace(self, other=self.faces(t).dot(D.T), turn=None)

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        """The moment sum lambda_k (A d_k) x (A_o e_k), without force."""
        far, none = self.place[None] if other is None else other, np.zeros((len(times), 3))
        faces = np.stack([self.faces(t) for t in times.tolist()])  # e: (T, l, 3)
        moment = none
        for k, d in enumerate(self.own):
            f = vectors_in_space(np.broadcast_to(far, (len(times), far.shape[1])), faces[:, k])
            moment = moment + forces[:, k : k + 1] * np.cross(vectors_in_space(pose, d), f)
        return Wrench(none, moment, none)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds the constraints g_k = (A d_k) . (A_o e_k) with their forces lambda_k d g_k/dq and
        second derivatives, row by row: own attitude, other attitude, mean rotation theta of the own
        set. j, o, k: numbers of the functionals of theta, of the other body's first coordinate (3
        of position, then attitude) and of the first multiplier in m.y. own, faces(t): d_k and e_k,
        (l, 3) in the axes of their bodies, e_k turned by a prescribed angle; turned: theta of the
        shape from which displacements are measured; place: pose of another body at rest.
        """
        far = attitude((m.y[o : o + self.others] if self.others else self.place)[3:])
        deforms = self.turns and m.elastic
        theta, at = self.turned, slice(j, j + 3)
        if deforms:
            theta = theta + m.s[at]
            # sigma: factors of theta in the elastic rows; sigma_y: d sigma / dy
            out.sigma[at] = 0.0
            out.sigma_y[:, at] = 0.0
        for i, (d0, e) in enumerate(zip(self.own, self.faces(m.t), strict=True)):
            # g = (A d) . f; D, D_o: derivatives of A d and of f by the attitudes
            lam, d, f = m.y[k + i], d0 + rot.cross(theta, d0), far.A.dot(e)
            D, D_o = m.turn.of_body(d), far.of_body(e)
            self._own_rows(m, k + i, lam, d, f, D, out)
            out.rows[k + i] = m.A.dot(d).dot(f)
            if self.others:
                self._other_rows(m, far, o + 3, k + i, lam, m.A.dot(d), e, D, D_o, out)
            if deforms:
                self._mean_rotation(m, at, o, k + i, lam, rot.skew(d0), f, D_o, out)
        if deforms:  # d rows / d theta: all follow from one potential
            out.tau[:, at] = out.sigma_y[:, at]

    @staticmethod
    def _own_rows(
        m: Motion, k: int, lam: float, d: FloatArray, f: FloatArray, D: FloatArray, out: Sums
    ) -> None:
        """Rows and derivatives of the own attitude coordinates; D = d (A d) / dq."""
        g_q, at = f.dot(D), m.at
        out.rows[at] += lam * g_q
        out.H[k, at] = out.H[at, k] = g_q
        out.H[at, at] += lam * m.turn.bend(f, d)

    @staticmethod
    def _other_rows(
        m: Motion, far: Attitude, o: int, k: int, lam: float, Ad: FloatArray, e: FloatArray,
        D: FloatArray, D_o: FloatArray, out: Sums,
    ) -> None:
        """Rows and derivatives of the other body's attitude coordinates, numbered from o, and mixed
        derivatives, of lam g with g = (A d) . (A_o e) in row k; D, D_o (3, n): derivatives of A d
        and A_o e by the own and the other attitude; far: the other attitude, A_o."""
        H, g_o, mixed, at_o = out.H, Ad.dot(D_o), lam * D.T.dot(D_o), slice(o, o + far.size)
        out.rows[at_o] += lam * g_o
        H[k, at_o] = H[at_o, k] = g_o
        H[at_o, at_o] += lam * far.bend(Ad, e)
        H[m.at, at_o] += mixed
        H[at_o, m.at] += mixed.T

    def _mean_rotation(
        self, m: Motion, at: slice, o: int, k: int, lam: float, lever: FloatArray, f: FloatArray,
        D_o: FloatArray, out: Sums,
    ) -> None:
        """Contribution of the mean rotation theta of a flexible set, at its functionals `at`: dg =
        (d0 x A^T f) . d theta, lever = d0~ (cross-product matrix); f = A_o e in space axes, D_o:
        its derivative by the other attitude, whose coordinates follow 3 of position from o on.
        sigma: factors of theta in the elastic rows; sigma_y: d sigma / dy, y with the multiplier at
        k."""
        g_theta = lever.dot(m.A.T.dot(f))
        out.sigma[at] += lam * g_theta
        out.sigma_y[k, at] = g_theta
        out.sigma_y[m.at, at] += lam * lever.dot(m.turn.of_space(f)).T
        if self.others:
            out.sigma_y[o + 3 : o + self.others, at] += lam * lever.dot(m.A.T.dot(D_o)).T


@dataclass(frozen=True, slots=True, eq=False)
class Slide(SpatialItem):
    """Point-on-line constraints g_k = (R + A z - R_o - A_o z_o) . (A_o e_k): the own point stays on
    lines of the other body.

    point (d,) = z in own axes, m; lines (l, d) = e, normals, and base (d,) = z_o, m, in the other
    body's axes; others: number of the other body's rigid coordinates that are unknowns, 0 if it is
    at rest at `place`.
    """

    point: FloatArray
    lines: FloatArray
    base: FloatArray
    others: int
    place: FloatArray

    @property
    def directions(self) -> int:
        return len(self.point)

    @property
    def forces(self) -> int:
        return len(self.lines)

    @property
    def reactions(self) -> tuple[tuple[str, str], ...]:
        return (("force across the axis", "N"),) * self.forces

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(f"joint {source} {a}" for a in AXES[: self.directions])

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Slide":
        return replace(self, point=self.point + s)

    def in_plane(self) -> plane.PlanePart:
        """Its one line (numbers: `plane_items.slide`)."""
        place = self.place.tolist() if not self.others else [0.0] * 3
        return plane.PlanePart(plane.slide, (
            *self.point.tolist(), *self.lines[0].tolist(), float(self.lines[0] @ self.base),
            float(self.others > 0), *place))

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        """The force sum lambda_k A_o e_k at the own point, which the other body answers there."""
        far, d = self.place[None] if other is None else other, len(self.point)
        force = np.zeros((len(times), d))
        for k, e in enumerate(self.lines):
            force = force + forces[:, k : k + 1] * vectors_in_space(far, e)
        reach = points_in_space(pose, np.broadcast_to(self.point, (len(pose), d)))
        return Wrench(force, np.zeros((len(times), 2 * d - 3)), reach)

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        """One constraint (R + A z - R_o) . A_o e = e . z_o for each line normal e, with z = `point`
        and z_o = `base`; of a body at rest (`others` 0, pose `place`) e and the right-hand side are
        given in space axes, where the latter is (A_o e) . (R_o + A_o z_o)."""
        A, place = np.eye(3), np.zeros(3)
        if not self.others:
            A, place = attitude(self.place[3:]).A, self.place[:3]
        parts = []
        for row, e in enumerate(self.lines):
            numbers = spatial.constraint_numbers(
                self.point, A @ e, float(e @ self.base + (A @ e) @ place), others=self.others,
                kind=spatial.POINT)
            parts.append(spatial.SpacePart(spatial.constraint, numbers, row=row))
        return tuple(parts)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds the constraints n . (R + A z - R_o - A_o base) = 0 along the line normals n = A_o e,
        fixed in the other body, with their forces and second derivatives; D = d (A z) / dq.

        j: first functional, the displacement of the point z; o: first coordinate of the other body
        in m.y; k: first multiplier. H: d rows / dy; bend(f, z): second derivative of f . A z by the
        attitude q, of_space(f): derivative of A^T f.
        """
        y_o = m.y[o : o + self.others] if self.others else self.place
        far = attitude(y_o[3:])
        z = self.point + m.s[j : j + 3] if m.elastic else self.point
        gap, D = m.R + m.A.dot(z) - y_o[:3], m.turn.of_body(z)
        lam = m.y[k : k + self.forces]
        lines, n = self.lines, far.A.dot(self.lines.T).T  # (l, 3) in space axes
        own, multipliers = m.at, slice(k, k + self.forces)
        f = lam.dot(n)  # force on the own point, in space axes
        H = out.H
        out.rows[multipliers] = n.dot(gap) - lines.dot(self.base)
        out.rows[:3] += f
        out.rows[own] += f.dot(D)
        H[multipliers, :3], H[:3, multipliers] = n, n.T
        H[multipliers, own] = n.dot(D)
        H[own, multipliers] = H[multipliers, own].T
        H[own, own] += m.turn.bend(f, z)
        if self.others:
            self._other_rows(m, far, o, k, lam, gap, n, D, out)
        if m.elastic:  # sigma: factors in the elastic rows; sigma_y: d sigma / dy; tau: d rows / ds
            at = slice(j, j + 3)
            out.sigma[at] = m.A.T.dot(f)
            out.sigma_y[own, at] = m.turn.of_space(f).T
            out.sigma_y[multipliers, at] = n.dot(m.A)
            if self.others:
                f_by = far.of_body(lam.dot(lines))  # by the other's attitude
                out.sigma_y[o + 3 : o + self.others, at] = f_by.T.dot(m.A)
            out.tau[:, at] = out.sigma_y[:, at]

    def _other_rows(
        self, m: Motion, far: Attitude, o: int, k: int, lam: FloatArray, gap: FloatArray,
        n: FloatArray, D: FloatArray, out: Sums,
    ) -> None:
        """Rows and derivatives of the other body's rigid coordinates, numbered from o: position,
        then attitude; k: first multiplier. Of the sum lam_i n_i . (gap - A_o z_o): gap = R + A z -
        R_o; n (l, 3) = A_o e; D (3, n): derivative of A z by the own attitude."""
        H, f_o = out.H, lam.dot(self.lines)  # force on the own point, in the other's axes
        place, at_o = slice(o, o + 3), slice(o + 3, o + self.others)
        f_by = far.of_body(f_o)  # derivative of A_o f_o by the other's attitude
        out.rows[place] -= lam.dot(n)
        out.rows[at_o] += gap.dot(f_by)
        H[at_o, at_o] += far.bend(gap, f_o)
        for rows, block in ((slice(0, 3), f_by), (m.at, D.T.dot(f_by)), (place, -f_by)):
            H[rows, at_o] += block
            H[at_o, rows] += block.T
        for i, e in enumerate(self.lines):
            H[k + i, place] = H[place, k + i] = -n[i]
            H[k + i, at_o] = H[at_o, k + i] = gap.dot(far.of_body(e))


@dataclass(frozen=True, slots=True, eq=False)
class Turned:
    """Angle of a body, rad, about an axis fixed in space: atan2(A d . e_2, A d . e_1); own (3,) = d
    in body axes; first, second (3,) = e_1, e_2 in space axes, perpendicular to the axis."""

    own: FloatArray
    first: FloatArray
    second: FloatArray

    def __call__(self, y: FloatArray) -> Jet:
        """The angle with its first (n,) and second (n, n) derivatives by the rigid coordinates
        y (n,) of a body in space, of which the position y[:3] does not matter. _cosine: A d . e
        with both derivatives by the attitude."""
        turn = attitude(y[3:])
        cosine, sine = (_cosine(turn, self.own, e) for e in (self.first, self.second))
        angle, by_attitude, bend = of_angle(cosine, sine)
        first, second = np.zeros(len(y)), np.zeros((len(y), len(y)))
        first[3:], second[3:, 3:] = by_attitude, bend
        return angle, first, second


def _cosine(turn: Attitude, d: FloatArray, e: FloatArray) -> Jet:
    """A d . e with its derivatives by the attitude coordinates."""
    return float(turn.A.dot(d).dot(e)), e.dot(turn.of_body(d)), turn.bend(e, d)


@dataclass(frozen=True, slots=True, eq=False)
class Shifted:
    """Distance (R + A z) . e - start, m, of a point of a body along a direction of space; point
    (3,) = z, m, in body axes, along (3,) = e; start, m: its (R + A z) . e where the distance is
    0."""

    point: FloatArray
    along: FloatArray
    start: float

    def __call__(self, y: FloatArray) -> Jet:
        """The distance with its first (n,) and second (n, n) derivatives by the rigid coordinates
        y (n,) in space, position first. of_body, bend: first derivative of A z and second one of e
        . A z by the attitude."""
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
    these do not matter where the sum is wrapped into -pi to pi. factors: n_1, n_2; scale: 1 / n_1
    of gears, the pitch radius, m, of a rack; others: number of the other body's rigid coordinates;
    unit: of the multiplier.
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
        """Adds the constraint scale (n_1 q_1 + n_2 q_2) = 0 in row k, the forces of its multiplier
        m.y[k] and derivatives; of a sum over pi the whole turns are dropped. `own`, `other`: q_1,
        q_2 with first and second derivatives by the rigid coordinates of each body, the other's
        from o on in m.y; j: not used."""
        own, other = slice(0, m.at.stop), slice(o, o + self.others)
        q1, q1_first, q1_second = self.own(m.y[own])
        q2, q2_first, q2_second = self.other(m.y[other])
        n1, n2 = self.factors
        u, lam = n1 * q1 + n2 * q2, m.y[k]
        out.rows[k] = self.scale * (u - 2.0 * pi * round(u / (2.0 * pi)))
        for at, n, first, second in (
                (own, n1, q1_first, q1_second), (other, n2, q2_first, q2_second)):
            out.rows[at] += lam * self.scale * n * first
            out.H[at, at] += lam * self.scale * n * second
            out.H[k, at] = out.H[at, k] = self.scale * n * first
