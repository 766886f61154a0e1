"""Rotational spring and damper with a motor torque, in the plane."""

from typing import ClassVar, Self

from pydantic import Field, model_validator

from sparsemor.bodies.frames.springs import RotationalSpring as Item
from sparsemor.bodies.joints.force_element import Drive, ForceElement
from sparsemor.bodies.joints.side import Side
from sparsemor.bodies.loads.amplitude import NumberOrFunction


class RotationalSpring(ForceElement):
    """Rotational spring, damper and motor on the relative angle of two sides in the plane.

    Moment torque - stiffness (phi - angle) - damping (phi' - angle') on the first side, N m, and
    the opposite one on the second; phi: their relative angle, zero at the start. It is used
    together with a revolute joint of the same sides. With a large stiffness and `angle` a function
    of time it is a position drive. A flexible side has multipliers: the force on it, zero, and the
    moment, N m.
    """

    dimensions: ClassVar[tuple[int, ...]] = (2,)
    turns: ClassVar[bool] = True

    stiffness: float = Field(default=0.0, ge=0.0)
    """Stiffness, N m/rad."""
    damping: float = Field(default=0.0, ge=0.0)
    """Damping, N m s/rad."""
    angle: NumberOrFunction | None = None
    """Relative angle at which the spring is relaxed, rad; zero when not given."""
    torque: NumberOrFunction | None = None
    """Moment of the motor on the first side, N m, counterclockwise."""

    @model_validator(mode="after")
    def _acts(self) -> Self:
        if not self.stiffness and not self.damping and self.torque is None:
            raise ValueError("it does nothing: give a stiffness, a damping or a torque")
        return self

    def item(self, own: Side, other: Side, first: bool) -> Item:
        sign = 1.0 if first else -1.0
        start = float(own.pose[2] - other.pose[2])
        drive = Drive(self.stiffness, self.damping, start, self.angle, self.torque, sign, -sign)
        return Item(self.stiffness, self.damping, drive, len(other.pose) if other.reads else 0,
                    float(other.pose[2]))
