"""Base of force elements by a law of one relative coordinate of two sides: an angle or a distance.
"""

from abc import abstractmethod
from typing import Literal

import numpy as np

from sparsemor.bodies.frames.relative import (
    Angle,
    Distance,
    Numbers,
    PlaneAngle,
    RelativeItem,
)
from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.frames.springs import SpatialRotationalSpring
from sparsemor.bodies.joints.force_element import Drive, ForceElement, ItemForce
from sparsemor.bodies.joints.side import Side, unit
from sparsemor.core import FloatArray, InputError

RECORDED = {"turn": ("torque", "N m"), "slide": ("force", "N")}
"""Name and unit of the recorded force, on the first side."""


class Relative(ForceElement):
    """Force on the relative motion of two sides that a joint leaves free, next to that joint."""

    motion: Literal["turn", "slide"] = "turn"
    """Relative motion: `turn`, the angle that a revolute or cylindrical joint leaves free, counter-
    clockwise and in space about `axis`, or `slide`, the distance along `axis` that a prismatic or
    cylindrical one does. It is that of the first side relative to the second, and zero at the
    start."""
    axis: tuple[float, float] | tuple[float, float, float] | None = None
    """Direction of the axis at the start (space axes)."""

    @property
    def acts_on_rotations(self) -> bool:
        return True

    @abstractmethod
    def law(self) -> Numbers:
        """Kind and numbers of the law (`relative_law`)."""

    @property
    def centre(self) -> float:
        """Angle, rad, to which that of two sides in space is nearest, among those that differ by
        two turns."""
        return 0.0

    def item(self, own: Side, other: Side, first: bool) -> RelativeItem:
        if self.motion == "turn" and own.d == 2 and self.axis is not None:
            raise InputError("plane bodies turn about the normal of the plane: drop it", "axis")
        axis = np.zeros(2) if self.motion == "turn" and own.d == 2 else unit(self.axis, own.d)
        return relative_item(self.motion, axis, own, other, first, self.law(), self.centre)

    def _law(self, item: object, first: bool) -> ItemForce:
        assert isinstance(item, RelativeItem)
        return ItemForce(item, -1.0)


def relative_item(
    motion: str, axis: FloatArray, own: Side, other: Side, first: bool, law: Numbers,
    near: float = 0.0,
) -> RelativeItem:
    """Item of the frame of `own` for a law of the angle about an axis (d,) or of the distance along
    it, in space axes at the start; first: True if `own` is the first side, relative to whose other
    one the coordinate is."""
    others, sign = len(other.pose) if other.reads else 0, 1.0 if first else -1.0
    coordinate: Distance | PlaneAngle | Angle
    if motion == "slide":
        # a coordinate that is zero at the start, as the ground's point is the other's
        base = (own.place() - other.pose[: own.d]) @ other.axes
        coordinate = Distance(own.point, base, axis @ other.axes, others, other.pose)
    elif own.d == 2:
        coordinate = PlaneAngle(float(own.pose[2] - other.pose[2]))
    else:
        e1, e2 = across(axis)
        coordinate = Angle(SpatialRotationalSpring(
            e1 @ own.axes, e1 @ other.axes, e2 @ other.axes, 0.0, 0.0,
            Drive(0.0, 0.0, 0.0, None, None, None), others, other.pose, own.pose[3:]), sign * near)
    return RelativeItem(coordinate, law, sign, others, other.pose)
