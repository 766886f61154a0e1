"""Prismatic joint: one direction of translation, no rotation. Its rows: `slide`
of conditions.py."""

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.between import Between
from sparsemor.bodies.joints.conditions import Conditions
from sparsemor.bodies.joints.side import unit
from sparsemor.bodies.pose import Vector


class Prismatic(Between):
    """Prismatic joint: relative translation along an axis fixed in one body, no relative rotation.

    The axis is fixed in the second body or the ground; in the first, if only the second is
    flexible; in a frame that moves with the first set, if both are.

    Multipliers: the forces on the first side perpendicular to the axis (two in space, one in the
    plane), N, and the moments (three in space, one in the plane), N m.
    """

    relative = (2, 3)

    axis: Vector
    """Direction of the axis at the start (space axes): two numbers in the plane, three in space."""

    def constrain(self, sides: Conditions) -> None:
        sides.slide(across(unit(self.axis, sides.d)))
        sides.no_turn()
