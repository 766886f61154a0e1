"""Parts of the equations of a body's frame: forces, attachments, reactions (notation: motion.py).

An item has the same data in the plane and in space. In space it adds its share of the rigid rows
and writes its own columns (`evaluate`): directions from j on, the coordinates of another body from
o on, its own border unknowns (forces) from k on. In the plane its counterpart in complex numbers
does (`in_plane`, plane_items.py). `names` says what each direction is a load of, "" where it only
serves the rows of the frame.

Forces that have a potential use its exact derivatives by p; they differ from 2 G^T torque by a
multiple of p, which the multiplier of |p| = 1 takes up.
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
    """force (T, d), N, at the own point and moment (T, r), N m, on the own side, in space axes;
    reach (T, d), m: where that force meets the other body, None where it has no part in it."""

    force: FloatArray
    moment: FloatArray
    reach: FloatArray | None


class Item(Protocol):
    """One part of a frame's equations. directions, others, forces: how many functionals of the
    displacements, coordinates of another body and border unknowns it has."""

    @property
    def directions(self) -> int: ...
    @property
    def others(self) -> int: ...
    @property
    def forces(self) -> int: ...
    def names(self, source: str) -> tuple[str, ...]: ...
    def shifted(self, s: FloatArray, quadratic: FloatArray) -> Self:
        """The same item about a deformed shape: s (directions,) its functionals of that shape,
        quadratic (g,) = u.M_g u."""
        ...


class SpatialItem(Item, Protocol):
    """An item as the frame of a body in space evaluates it."""

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None: ...


class PlanarItem(Item, Protocol):
    """An item as the frame of a body in the plane evaluates it; directions come in pairs there."""

    def in_plane(self) -> plane.PlaneItem: ...


@runtime_checkable
class Timed(Protocol):
    """An item whose constraint rows depend on time alone, and which knows how."""

    def time_derivative(self, order: int, t: float, h: float) -> SpatialItem | None:
        """The item of the partial derivative of order 1 or 2 at t, s; None where that is zero."""
        ...


@runtime_checkable
class Pushing(Protocol):
    """An item that acts on displacements where the frame's motion is prescribed: `push` writes all
    of it to `out`, at one time or many."""

    def push(self, m: Moved, j: int, out: Pushed) -> None: ...


@runtime_checkable
class Holding(Protocol):
    """An item of a joint: what its multipliers do to the body."""

    @property
    def reactions(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each of its forces, such as ("force x", "N")."""
        ...

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        """Of multipliers `forces` (T, forces), N or N m, at times (T,), s, under poses (T, n) or
        (1, n) of the own body and of the other one, None where that does not move."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class UnitLength:
    """(p.p - 1)/2 = 0; its border unknown is the multiplier, N m."""

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
    """Nodal weights times one force in space axes (gravity: weights are nodal masses).

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
        return plane.SpaceForce(
            self.total, complex(*self.arm), complex(*self.force), self.amplitude)

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
    """A nodal load that turns with the body. total (d,) = sum f, N; arm (r,) = sum X x f, N m.

    Directions: the load itself, and the r functionals sum u x f.
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
        return plane.BodyForce(complex(*self.total), float(self.arm[0]), self.amplitude)

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
    """Mean position of a weighted set of points; its border unknowns are the force on it (d, N).

    point (d,) = sum w X with sum w = 1, m.
    """

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
        return plane.Attachment(complex(*self.point))

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
    """Rotation of a body in the plane or, if it `turns`, mean rotation of a set of its points, rad;
    its border unknown is the moment, N m. angle: mean rotation in the shape that displacements
    count from."""

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
        return plane.Rotation(self.turns, self.angle)


@dataclass(frozen=True, slots=True, eq=False)
class Reaction:
    """Prescribed force (N) of a joint on the mean point of a set and, where it `turns`, moment
    (N m) on its mean rotation, space axes, (T, d + r), on a frame with prescribed motion, whose own
    equations are not solved: it acts on displacements alone.
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
    """An item that adds nothing, in the place of another one of the same shape; inert: of the
    inertia."""

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
