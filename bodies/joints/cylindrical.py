"""Cylindrical joint: translation along an axis in space and rotation about it."""

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.between import Between
from sparsemor.bodies.joints.conditions import Conditions
from sparsemor.bodies.joints.side import unit


class Cylindrical(Between):
    """Cylindrical joint: rotation about and translation along one axis that both bodies share.

    Four multipliers: two forces perpendicular to the axis, N, and two moments, N m.
    """

    dimensions = (3,)
    relative = (3,)

    axis: tuple[float, float, float]
    """Direction of the axis at the start (space axes)."""

    def constrain(self, sides: Conditions) -> None:
        axis = unit(self.axis, 3)
        sides.slide(across(axis))
        sides.face([axis, axis], across(axis))
