"""Spherical joint: two points in space coincide, all rotations are free."""

from sparsemor.bodies.joints.between import Between
from sparsemor.bodies.joints.conditions import Conditions


class Spherical(Between):
    """Spherical joint: the centres of two sets coincide, or one is fixed in space.

    In the plane: `revolute`.

    Three multipliers: the force on the first side, N (space axes).
    """

    dimensions = (3,)

    def constrain(self, sides: Conditions) -> None:
        sides.meet()
