"""Parts (items) of the equations of a body frame: forces, attachments, reactions (notation:
motion.py).

An item has the same data in the plane and in space. In space `evaluate` adds its contribution to
the rigid equations and writes its own columns: functionals of the displacements (directions) from
number j on, coordinates of another body from o on, its own multipliers (forces) from k on. In the
plane its complex counterpart does so (`in_plane`, plane_items.py). `names` describes the load of
each functional, "" for those that only enter the frame's equations. Forces with a potential use its
exact derivatives by the quaternion p; these differ from 2 G^T torque by a multiple of p, which the
multiplier of |p| = 1 absorbs.
"""

from dataclasses import dataclass, replace
from typing import Protocol, Self, runtime_checkable

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames.many_times import Moved, Pushed
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import Amplitude, FloatArray, Table

AXES = ("x", "y", "z")
EYE = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class Wrench:
    """Joint reaction on the own side in space axes: force (T, d), N, at the own point, and moment
    (T, r), N m.

    reach (T, d), m: point at which the force acts on the other body; None if the item does not act
    on the other body.
    """

    force: FloatArray
    moment: FloatArray
    reach: FloatArray | None


class Item(Protocol):
    """One part of a frame's equations.

    directions, others, forces: its numbers of functionals of the displacements, coordinates of
    another body, and multipliers.
    """

    @property
    def directions(self) -> int: ...
    @property
    def others(self) -> int: ...
    @property
    def forces(self) -> int: ...
    def names(self, source: str) -> tuple[str, ...]: ...
    def shifted(self, s: FloatArray, quadratic: FloatArray) -> Self:
        """The same item with displacements measured from a deformed shape: s (directions,) its
        functionals of that shape, quadratic (g,) = u.M_g u."""
        ...


class SpatialItem(Item, Protocol):
    """Part of the equations of a frame in space."""

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None: ...


class PlanarItem(Item, Protocol):
    """Part of the equations of a frame in the plane, where functionals come in pairs."""

    def in_plane(self) -> plane.PlaneItem: ...


@runtime_checkable
class Timed(Protocol):
    """An item whose constraints depend explicitly on time, with their partial derivatives."""

    def time_derivative(self, order: int, t: float, h: float) -> SpatialItem | None:
        """Item with the partial time derivative of order 1 or 2 at t, s; None where it is zero."""
        ...


@runtime_checkable
class Pushing(Protocol):
    """An item that acts on displacements under prescribed frame motion: `push` writes its loads to
    `out`, at one time or many."""

    def push(self, m: Moved, j: int, out: Pushed) -> None: ...


@runtime_checkable
class Holding(Protocol):
    """An item of a joint, with the reaction of its multipliers on the body."""

    @property
    def reactions(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each of its multipliers, such as ("force x", "N")."""
        ...

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        """Reaction of multipliers `forces` (T, forces), N or N m, at times (T,), s.

        pose, other (T, n) or (1, n): rigid coordinates of the own and of the other body, None for
        one at rest.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class UnitLength:
    """Constraint (p.p - 1)/2 = 0 of a unit quaternion p, with a multiplier, N m."""

    directions = 0
    others = 0
    forces = 1

    def names(self, source: str) -> tuple[str, ...]:
        return ()

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "UnitLength":
        return self

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        mu, p = m.y[k], m.y[m.at]
        out.rows[m.at] += mu * p
        out.rows[k] = 0.5 * (p.dot(p) - 1.0)
        out.H[m.at, k] = out.H[k, m.at] = p
        out.diagonal[m.at] += mu


@dataclass(frozen=True, slots=True, eq=False)
class SpaceForce:
    """Nodal weights times one force in space axes (for gravity the weights are nodal masses).

    total = sum w, arm (d,) = sum w X, force (d,) per unit weight, N.
    """

    total: float
    arm: FloatArray
    force: FloatArray
    amplitude: Amplitude
    others = 0
    forces = 0

    @property
    def directions(self) -> int:
        return len(self.arm)

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(f"{source} {a}" for a in AXES[: self.directions])

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "SpaceForce":
        return replace(self, arm=self.arm + s)

    def in_plane(self) -> plane.PlaneItem:
        return plane.PlanePart(plane.space_force, (
            float(self.total), *self.arm.tolist(), *self.force.tolist()), self.amplitude)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        f = self.amplitude(m.t) * self.force
        arm = self.arm + m.s[j : j + 3] if m.elastic else self.arm
        out.rows[:3] -= self.total * f
        out.rows[m.at] -= f.dot(m.turn.of_body(arm))
        out.H[m.at, m.at] -= m.turn.bend(f, arm)
        if m.elastic:
            at = slice(j, j + 3)
            self.push(m, j, out)
            out.sigma_y[m.at, at] = out.tau[m.at, at] = -m.turn.of_space(f).T

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        out.sigma[..., j : j + 3] = -m.factor(self.amplitude) * m.in_body(self.force)


@dataclass(frozen=True, slots=True, eq=False)
class BodyForce:
    """Nodal load that rotates with the body: total (d,) = sum f, N; arm (r,) = sum X x f, N m.

    Functionals: the load itself, and the r components of sum u x f.
    """

    total: FloatArray
    arm: FloatArray
    amplitude: Amplitude
    others = 0
    forces = 0

    @property
    def directions(self) -> int:
        return 1 + len(self.arm)

    def names(self, source: str) -> tuple[str, ...]:
        return (source, *("" for _ in self.arm))

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "BodyForce":
        return replace(self, arm=self.arm + s[1:])

    def in_plane(self) -> plane.PlaneItem:
        return plane.PlanePart(plane.body_force, (
            *self.total.tolist(), float(self.arm[0])), self.amplitude)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        g = self.amplitude(m.t)
        out.rows[:3] -= g * m.A.dot(self.total)
        out.H[:3, m.at] -= g * m.turn.of_body(self.total)
        out.torque -= g * (self.arm + m.s[j + 1 : j + 4] if m.elastic else self.arm)
        if m.elastic:
            self.push(m, j, out)
            out.torque_s[:, j + 1 : j + 4] = -g * EYE

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        out.sigma[..., j : j + 1] = -m.factor(self.amplitude)


@dataclass(frozen=True, slots=True, eq=False)
class Attachment:
    """Mean position of a weighted set of points, point (d,) = sum w X with sum w = 1, m; its
    multipliers are the force on it (d, N)."""

    point: FloatArray
    others = 0

    @property
    def directions(self) -> int:
        return len(self.point)

    @property
    def forces(self) -> int:
        return len(self.point)

    @property
    def reactions(self) -> tuple[tuple[str, str], ...]:
        return tuple((f"force {a}", "N") for a in AXES[: self.forces])

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(f"joint {source} {a}" for a in AXES[: self.directions])

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Attachment":
        return replace(self, point=self.point + s)

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        return Wrench(forces, np.zeros((len(times), 2 * len(self.point) - 3)), None)

    def in_plane(self) -> plane.PlaneItem:
        return plane.PlanePart(plane.attachment, tuple(self.point.tolist()))

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        f, mine = m.y[k : k + 3], slice(k, k + 3)
        z = self.point + m.s[j : j + 3] if m.elastic else self.point
        dz = m.turn.of_body(z)
        out.rows[:3] += f
        out.rows[m.at] += f.dot(dz)
        out.rows[mine] = m.R + m.A.dot(z)
        H = out.H
        H[:3, mine] = H[mine, :3] = EYE
        H[mine, m.at], H[m.at, mine] = dz, dz.T
        H[m.at, m.at] += m.turn.bend(f, z)
        if m.elastic:
            at = slice(j, j + 3)
            out.sigma[at] = m.A.T.dot(f)
            out.sigma_y[m.at, at] = out.tau[m.at, at] = m.turn.of_space(f).T
            out.sigma_y[mine, at] = out.tau[mine, at] = m.A


@dataclass(frozen=True, slots=True, eq=False)
class Rotation:
    """Rotation of a body in the plane or, with `turns`, mean rotation of a set of its points, rad;
    its multiplier is the moment, N m.

    angle: mean rotation in the shape from which displacements are measured, rad.
    """

    turns: bool
    angle: float = 0.0
    others = 0
    forces = 1
    reactions = (("moment", "N m"),)

    @property
    def directions(self) -> int:
        return 2 if self.turns else 0

    def names(self, source: str) -> tuple[str, ...]:
        return (f"joint {source} turn", "") if self.turns else ()

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Rotation":
        return replace(self, angle=self.angle + float(s[0])) if self.turns else self

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        return Wrench(np.zeros((len(times), 2)), forces, None)

    def in_plane(self) -> plane.PlaneItem:
        return plane.PlanePart(plane.rotation, (float(self.turns), self.angle))


@dataclass(frozen=True, slots=True, eq=False)
class Reaction:
    """Prescribed joint force (N) on the mean point of a set and, with `turns`, moment (N m) on its
    mean rotation: table (T, d + r), space axes.

    For a frame with prescribed motion, whose rigid equations are not solved: it acts on
    displacements alone.
    """

    forces_at: Table
    turns: bool
    others = 0
    forces = 0

    @property
    def directions(self) -> int:
        d = 3 if self.forces_at.values.shape[1] == 6 else 2
        return 2 * d if self.turns else d

    def names(self, source: str) -> tuple[str, ...]:
        d = self.directions // 2 if self.turns else self.directions
        force = tuple(f"{source} {a}" for a in AXES[:d])
        turn = tuple(f"{source} turn {a}" for a in AXES) if d == 3 else (f"{source} turn", "")
        return force + turn if self.turns else force

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Reaction":
        return self

    def in_plane(self) -> plane.PlaneItem:
        return plane.Reaction(self.forces_at, self.turns)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        if m.elastic:
            self.push(m, j, out)

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        at = m.tabled(self.forces_at)
        for i in range(0, self.directions, 3):
            out.sigma[..., j + i : j + i + 3] = m.in_body(at[..., i : i + 3])


@dataclass(frozen=True, slots=True)
class Nothing:
    """Item with zero contribution instead of another one with the same numbers of functionals,
    coordinates and multipliers; inert: instead of the inertia."""

    directions: int
    others: int
    forces: int
    inert: bool = False

    def names(self, source: str) -> tuple[str, ...]:
        return ("",) * self.directions

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Nothing":
        return self

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        if m.elastic:
            out.sigma[j : j + self.directions] = 0.0
            out.sigma_y[:, j : j + self.directions] = 0.0
            out.tau[:, j : j + self.directions] = 0.0
