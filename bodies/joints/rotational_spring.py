"""Rotational spring and damper with a motor torque."""

from dataclasses import replace
from typing import ClassVar, Self

from pydantic import Field, model_validator

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.frames.springs import (
    RotationalSpringItem,
    SpatialRotationalSpring,
    SpringItem,
)
from sparsemor.bodies.joints.force_element import Drive, ForceElement
from sparsemor.bodies.joints.side import Side, unit
from sparsemor.bodies.loads.part import NumberOrFunction
from sparsemor.core import InputError


class RotationalSpring(ForceElement):
    """Rotational spring, damper and motor on the relative angle of two sides.

    Moment torque - stiffness (phi - angle) - damping (phi' - angle') on the first side, N m, and
    the opposite one on the second; phi: their relative angle, zero at the start, in space about
    `axis`. It has any size; but in space, unless both sides have spinning frames or are at rest, a
    run in which phi - angle of a spring with a stiffness leaves -2 pi to 2 pi ends. It is used
    together with
    a revolute joint of the same sides. With a large stiffness and `angle` a function of time it is
    a position drive. A flexible side has multipliers: the force on it, zero, and the moment, N m.
    """

    turns: ClassVar[bool] = True
    recorded: ClassVar[tuple[str, str]] = ("torque", "N m")

    stiffness: float = Field(default=0.0, ge=0.0)
    """Stiffness, N m/rad."""
    damping: float = Field(default=0.0, ge=0.0)
    """Damping, N m s/rad."""
    angle: NumberOrFunction | None = None
    """Relative angle at which the spring is relaxed, rad; zero when not given."""
    torque: NumberOrFunction | None = None
    """Moment of the motor on the first side, N m, counterclockwise, in space about `axis`."""
    axis: tuple[float, float, float] | None = None
    """In space: direction of the axis at the start (space axes)."""

    @model_validator(mode="after")
    def _acts(self) -> Self:
        if not self.stiffness and not self.damping and self.torque is None:
            raise ValueError("it does nothing: give a stiffness, a damping or a torque")
        return self

    def item(self, own: Side, other: Side, first: bool) -> SpringItem:
        sign = 1.0 if first else -1.0
        others = len(other.pose) if other.reads else 0
        start = float(own.pose[2] - other.pose[2]) if own.d == 2 else 0.0
        drive = Drive.of(self.stiffness, self.damping, start, self.angle, self.torque, sign, -sign)
        if own.d == 2:
            if self.axis is not None:
                raise InputError("plane bodies turn about the normal of the plane: drop it", "axis")
            return RotationalSpringItem(
                self.stiffness, self.damping, drive, others, float(other.pose[2]))
        axis = unit(self.axis, 3)
        e1, e2 = across(axis)
        return SpatialRotationalSpring(
            e1 @ own.axes, e1 @ other.axes, e2 @ other.axes, self.stiffness, self.damping,
            replace(drive, stiffness=0.0), others, other.pose, own.pose[3:],
            None if self.angle is None else replace(
                drive, stiffness=-1.0, damping=0.0, load=None))
