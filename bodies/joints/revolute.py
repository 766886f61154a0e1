"""Revolute joint: two attachment points coincide, and in space also an axis."""

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.between import Between
from sparsemor.bodies.joints.conditions import Conditions
from sparsemor.bodies.joints.side import unit
from sparsemor.core import InputError


class Revolute(Between):
    """Revolute joint: the centres of two sets coincide; rotation about the axis is free.

    With one set, its centre is fixed in space. In the plane the axis is normal to it.

    Multipliers: the force on the first side, N (space axes); in space two moments perpendicular to
    the axis, N m.
    """

    relative = (3,)

    axis: tuple[float, float, float] | None = None
    """In space: direction of the axis at the start (space axes)."""

    def constrain(self, sides: Conditions) -> None:
        if sides.d == 2 and self.axis is not None:
            raise InputError("plane bodies turn about the normal of the plane: drop it", "axis")
        axis = None if sides.d == 2 else unit(self.axis, 3)
        sides.meet()
        if axis is not None:
            sides.face([axis, axis], across(axis))
