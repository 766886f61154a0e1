"""Universal joint (Cardan joint): two shafts that meet in a cross with two perpendicular axes."""

from sparsemor.bodies.joints.between import Between
from sparsemor.bodies.joints.conditions import Conditions
from sparsemor.bodies.joints.side import unit
from sparsemor.core import InputError


class Universal(Between):
    """Universal joint: two points coincide, and the axis of the cross fixed in the first body stays
    perpendicular to that fixed in the second one.

    Between shafts at an angle b the second turns by tan(angle_2) = tan(angle_1) / cos b. Four
    multipliers: the force on the first side, N (space axes), and the moment normal to the cross,
    N m.
    """

    dimensions = (3,)
    relative = (3,)

    axis: tuple[float, float, float]
    """Axis of the cross fixed in the first body, at the start (space axes)."""
    second_axis: tuple[float, float, float]
    """Axis of the cross fixed in the second body, perpendicular to the first one."""

    def constrain(self, sides: Conditions) -> None:
        one, two = unit(self.axis, 3), unit(self.second_axis, 3, "second_axis")
        if abs(one @ two) > 1e-9:
            raise InputError("the two axes of the cross are perpendicular at the start (their "
                             f"cosine is {one @ two:.3g})", "second_axis")
        sides.meet()
        own, other = (one, two) if sides.own is sides.first else (two, one)
        sides.face([own], [other])
