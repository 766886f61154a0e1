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
from typing import Protocol, Self

import numpy as np

from sparsemor.bodies.frames import plane_items as plane
from sparsemor.bodies.frames import space_items as spatial
from sparsemor.bodies.frames.motion import Motion, Moved, Pushed, Sums
from sparsemor.core import FloatArray
from sparsemor.core.protocols.body_frame import FrameWork

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
    """One part of a frame's equations, by default one of rigid coordinates alone.

    directions, others, forces: its numbers of functionals of the displacements, coordinates of
    another body, and multipliers.
    """

    __slots__ = ()
    others: int

    @property
    def directions(self) -> int:
        return 0

    @property
    def forces(self) -> int:
        return 0

    def names(self, source: str) -> tuple[str, ...]:
        return ("",) * self.directions

    def shifted(self, s: FloatArray, quadratic: FloatArray) -> Self:
        """The same item with displacements measured from a deformed shape: s (directions,) its
        functionals of that shape, quadratic (g,) = u.M_g u."""
        return self

    # ------------------------------------------------------------------ in space

    matrices: int = 0
    """Number of matrices of the displacements beyond those of the inertia."""

    def bend(self, work: FrameWork) -> None:
        """Writes derivatives of the factors of its matrices, which only the exact Jacobian has."""
        return None

    pushes: bool = False
    """True if `push` gives its loads on displacements under prescribed frame motion."""

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        """Writes its loads on displacements to `out`, at one time or many."""
        return None

    def time_derivative(self, order: int, t: float, h: float) -> "SpatialItem | None":
        """Item with the partial time derivative of its constraints, of order 1 or 2, at t, s; None
        where it is zero."""
        return None

    def in_space(self) -> tuple[spatial.SpacePart, ...] | None:
        """The item as functions on arrays, for compiled steps; None without them."""
        return None

    # ------------------------------------------------------------------ of joints

    unit: str = ""
    """Unit of its multipliers, N or N m, where `reactions` does not tell."""

    @property
    def reactions(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each of its multipliers, such as ("force x", "N"); () for an item
        without `wrench`."""
        return ()

    def wrench(
        self, times: FloatArray, forces: FloatArray, pose: FloatArray, other: FloatArray | None
    ) -> Wrench:
        """Reaction of multipliers `forces` (T, forces), N or N m, on the body at times (T,), s.

        pose, other (T, n) or (1, n): rigid coordinates of the own and of the other body, None for
        one at rest.
        """
        raise TypeError(f"{type(self).__name__} has no reactions")


class SpatialItem(Item, Protocol):
    """Part of the equations of a frame in space."""

    __slots__ = ()

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        """Adds its rows and their derivatives (`out`) at the motion m; j, o, k: numbers of its
        first functional, coordinate of another body and multiplier (notation: motion.py)."""
        ...


class PlanarItem(Item, Protocol):
    """Part of the equations of a frame in the plane, where functionals come in pairs."""

    __slots__ = ()

    def in_plane(self) -> plane.PlanePart: ...


class RigidItem(Item):
    """Item that depends on rigid coordinates alone, not on displacements."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, eq=False)
class Compliance(RigidItem):
    """Compliance of a constraint, g = compliance * multiplier, m/N or rad/(N m): minus compliance
    times the multiplier, in the row k of its own copy of the multiplier. The model sums the rows of
    all items of a multiplier, of which other ones have g (`FrameRecord.C`). H: derivative of the
    rows by y = (rigid coordinates, multipliers)."""

    compliance: float
    others = 0
    forces = 1

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane.compliance, (self.compliance,))

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(spatial.compliance, (self.compliance,)),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        out.rows[k] = -self.compliance * m.y[k]
        out.H[k, k] = -self.compliance


@dataclass(frozen=True, slots=True)
class Nothing(SpatialItem):
    """Item with zero contribution instead of another one with the same numbers of functionals
    (directions), coordinates of another body and multipliers (forces), so that other items keep
    their places, as for an item without a time derivative; inert: instead of the inertia; matrices:
    as many as that has. sigma, sigma_y and tau are overwritten by items and not cleared before."""

    directions: int = 0
    others: int = 0
    forces: int = 0
    inert: bool = False
    matrices: int = 0

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        if m.elastic:
            out.sigma[j : j + self.directions] = 0.0
            out.sigma_y[:, j : j + self.directions] = 0.0
            out.tau[:, j : j + self.directions] = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Stiffening(Item):
    """Force sum_j sigma_j H_j u on the displacements u, where sigma_j is the present factor of the
    load on functional j of the frame, and H_j the geometric stiffness of a unit of this load.

    matrices: number of functionals of the frame, all of which have one; first: number of inertia
    matrices M_g, which come before. It is the last item of its frame, so that sigma is complete:
    coefficients are factors of all matrices, kappa_y their derivatives by y, sigma[:-1] of the work
    arrays those of sigma.
    """

    first: int
    matrices: int = 0
    others = 0
    pushes = True

    def in_plane(self) -> plane.PlanePart:
        return plane.PlanePart(plane.stiffening, (float(self.matrices), float(self.first)))

    def in_space(self) -> tuple[spatial.SpacePart, ...]:
        return (spatial.SpacePart(
            spatial.stiffening, (float(self.matrices), float(self.first))),)

    def evaluate(self, m: Motion, j: int, o: int, k: int, out: Sums) -> None:
        self.push(m, j, out)

    def push(self, m: Moved, j: int, out: Pushed) -> None:
        out.coefficients[..., self.first : self.first + self.matrices] = out.sigma

    def bend(self, work: FrameWork) -> None:
        work.kappa_y[:, self.first : self.first + self.matrices] = work.sigma[:-1]
