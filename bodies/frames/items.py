"""Parts of the spatial frame equations: inertia, forces, attachments (notation: motion.py).

Each item adds its share of the rigid rows and writes its own columns: directions from j on, the
coordinates of another body from o on, its own border unknowns (forces) from k on. Forces that have
a potential use its exact derivatives by p; they differ from 2 G^T torque by a multiple of p, which
the multiplier of |p| = 1 takes up. `names` says what each direction is a load of, "" where it only
serves the rows of the frame.
"""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from sparsemor.bodies.frames.constraints import Wrench
from sparsemor.bodies.frames.many_times import Moved, Pushed
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import FloatArray, Table
from sparsemor.core.protocols.separable import Amplitude

AXES = ("x", "y", "z")
EYE = np.eye(3)


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

    total = sum w, arm (3,) = sum w X, force (3,) per unit weight, N.
    """

    total: float
    arm: FloatArray
    force: FloatArray
    amplitude: Amplitude
    directions = 3
    others = 0
    forces = 0

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(f"{source} {a}" for a in AXES)

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "SpaceForce":
        return replace(self, arm=self.arm + s)

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
    """A nodal load that turns with the body. total (3,) = sum f, N; arm (3,) = sum X x f, N m.

    Directions: the load itself, and the three functionals sum u x f.
    """

    total: FloatArray
    arm: FloatArray
    amplitude: Amplitude
    directions = 4
    others = 0
    forces = 0

    def names(self, source: str) -> tuple[str, ...]:
        return (source, "", "", "")

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "BodyForce":
        return replace(self, arm=self.arm + s[1:])

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
    """Mean position of a weighted set of points; its border unknowns are the force on it (3, N).

    point (3,) = sum w X with sum w = 1, m.
    """

    point: FloatArray
    directions = 3
    others = 0
    forces = 3

    def names(self, source: str) -> tuple[str, ...]:
        return tuple(f"joint {source} {a}" for a in AXES)

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Attachment":
        return replace(self, point=self.point + s)

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        return Wrench(forces, np.zeros_like(forces), None)

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
class Reaction:
    """A joint's force (N) on the mean point of a set and, where `turns`, its moment (N m) on the
    mean rotation, space axes, (T, 6): known, on a frame that is known. So the frame's own
    equations, which nobody solves, are left out.
    """

    forces_at: Table
    turns: bool
    others = 0
    forces = 0

    @property
    def directions(self) -> int:
        return 6 if self.turns else 3

    def names(self, source: str) -> tuple[str, ...]:
        what = ("", "turn ") if self.turns else ("",)
        return tuple(f"{source} {w}{a}" for w in what for a in AXES)

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Reaction":
        return self

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        if m.elastic:
            self.push(m, j, out)

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        known = m.tabled(self.forces_at)
        for i in range(0, self.directions, 3):
            out.sigma[..., j + i : j + i + 3] = m.in_body(known[..., i : i + 3])


class Item(Protocol):
    """One part of a spatial frame's equations. directions, others, forces: how many functionals of
    the displacements, coordinates of another body and border unknowns it has; `names`, `shifted`
    and `evaluate` as in the classes above."""

    @property
    def directions(self) -> int: ...
    @property
    def others(self) -> int: ...
    @property
    def forces(self) -> int: ...
    def names(self, source: str) -> tuple[str, ...]: ...
    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "Item": ...
    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None: ...


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


@runtime_checkable
class Timed(Protocol):
    """An item whose constraint rows depend on time alone, and which knows how."""

    def time_derivative(self, order: int, t: float, h: float) -> Item | None:
        """The item of the partial derivative of order 1 or 2 at t, s; None where that is zero."""
        ...


@runtime_checkable
class Pushing(Protocol):
    """An item that acts on displacements where the frame's motion is prescribed: `push` writes all
    of it to `out`, at one time or many."""

    def push(self, m: Moved, j: int, out: Pushed) -> None: ...


@runtime_checkable
class Holding(Protocol):
    """An item of a joint: what its multipliers do to the body, as a force and a moment."""

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        """Of multipliers `forces` (T, forces), N or N m, at times (T,), s, under poses (T, n) or
        (1, n) of the own body and of the other one, None where that does not move."""
        ...
