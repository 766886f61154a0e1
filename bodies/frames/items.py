"""Parts (items) of the equations of a body frame: forces, attachments, reactions (notation:
motion.py).

An item has the same data in the plane and in space. In space `evaluate` adds its contribution to
the rigid equations and writes its own columns: functionals of the displacements (directions) from
number j on, coordinates of another body from o on, its own multipliers (forces) from k on. In the
plane its complex counterpart does so (`in_plane`, plane_items.py), in compiled steps in space its
counterparts on arrays (`in_space`, space_items.py). `names` describes the load of
each functional, "" for those that only enter the frame's equations. Forces with a potential use its
exact derivatives by the quaternion p; these differ from 2 G^T torque by a multiple of p, which the
multiplier of |p| = 1 absorbs.
"""

from dataclasses import dataclass
from typing import Protocol, Self, runtime_checkable

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.many_times import Moved, Pushed
from sparsemor.bodies.frames.motion import Motion, Sums
from sparsemor.core import FloatArray

AXES = ("x", "y", "z")
EYE = np.eye(3)


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

    def in_plane(self) -> plane.PlanePart: ...


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


class RigidItem:
    """Item that depends on rigid coordinates alone, not on displacements."""

    __slots__ = ()
    directions = 0
    forces = 0

    def names(self, source: str) -> tuple[str, ...]:
        return ()

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> Self:
        return self


@dataclass(frozen=True, slots=True, eq=False)
class UnitLength(RigidItem):
    """Constraint (p.p - 1)/2 = 0 of a unit quaternion p, with a multiplier, N m."""

    others = 0
    forces = 1

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(spatial.unit_length, ()),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        mu, p = m.y[k], m.y[m.at]
        out.rows[m.at] += mu * p
        out.rows[k] = 0.5 * (p.dot(p) - 1.0)
        out.H[m.at, k] = out.H[k, m.at] = p
        out.diagonal[m.at] += mu


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
