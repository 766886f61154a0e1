"""Base of force elements by a law of one relative coordinate of two sides: an angle or a distance.
"""

from abc import abstractmethod
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.frames.springs import (
    STOP,
    Angle,
    Distance,
    Numbers,
    PlaneAngle,
    RelativeItem,
)
from sparsemor.bodies.joints.force_element import ForceElement, ItemForce
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

    @property
    def recorded(self) -> tuple[str, str]:  # type: ignore[override]
        return RECORDED[self.motion]

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
    sign = 1.0 if first else -1.0
    if motion == "turn":
        return RelativeItem(relative_angle(axis, own, other), law, sign, near=sign * near)
    # a coordinate that is zero at the start, as the ground's point is the other's
    base = (own.place() - other.pose[: own.d]) @ other.axes
    return RelativeItem(
        Distance(*unknowns(other), own.point, base, axis @ other.axes), law, sign)


def relative_angle(axis: FloatArray, own: Side, other: Side) -> PlaneAngle | Angle:
    """Angle of two sides since the start, in space about an axis (3,), in space axes at the start.
    """
    if own.d == 2:
        return PlaneAngle(*unknowns(other), float(own.pose[2] - other.pose[2]))
    e1, e2 = across(axis)
    return Angle(*unknowns(other), e1 @ own.axes, e1 @ other.axes, e2 @ other.axes, own.pose[3:])


def unknowns(other: Side) -> tuple[int, FloatArray]:
    """Number of rigid coordinates of a side that are unknowns, and its pose at the start."""
    return len(other.pose) if other.reads else 0, other.pose


NONE = 1e300
"""Angle or distance of a limit that is not given."""


class Stop(Relative):
    """Limits of the angle or distance that a joint of the same sides leaves free.

    Beyond a limit by the depth s acts the force stiffness s (1 + damping s') against it, never less
    than zero (Hunt and Crossley 1975, doi 10.1115/1.3423596). A body that meets the limit with the
    speed v leaves it with e v, where the restitution e follows from D = damping v alone, whatever
    the mass: D (1 + e) = ln((1 + D) / (1 - e D)), about e = 1 - 2/3 D for small D. Results store
    the force or moment on the first side.
    """

    lower: float | None = Field(default=None, le=0.0)
    """Lower limit, rad or m, measured from the start; none when not given."""
    upper: float | None = Field(default=None, ge=0.0)
    """Upper limit, rad or m, measured from the start; none when not given."""
    stiffness: float = Field(gt=0.0)
    """Stiffness, N m/rad or N/m."""
    damping: float = Field(default=0.0, ge=0.0)
    """Damping factor, s/rad or s/m: the restitution is 0.94 at a damping times speed
    of 0.1, 0.75 at 0.5, 0.59 at 1."""

    @model_validator(mode="after")
    def _limits(self) -> Self:
        if self.lower is None and self.upper is None:
            raise ValueError("it limits nothing: give lower, upper or both")
        return self

    def law(self) -> Numbers:
        lower, upper = (f if x is None else x for x, f in ((self.lower, -NONE), (self.upper, NONE)))
        return STOP, lower, upper, self.stiffness, self.damping

    @property
    def centre(self) -> float:
        """Between the limits, or the one limit."""
        given = [x for x in (self.lower, self.upper) if x is not None]
        return sum(given) / len(given)
