"""Springs and dampers: along the line between two points, with an actuator force, and rotational,
with a motor torque."""

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.frames.springs import Length, RelativeItem, linear
from sparsemor.bodies.initial_pose import Vector
from sparsemor.bodies.joints.force_element import Drive, ForceElement, relative_angle, unknowns
from sparsemor.bodies.joints.joint_sides import Side, size_of, unit
from sparsemor.bodies.loads.built_load import NumberOrFunction
from sparsemor.core import FloatArray, InputError


class SpringDamper(ForceElement):
    """Spring, damper and actuator along the line between two points.

    Force stiffness (l - length) + damping (l' - length') + force, N, positive pulls the points
    together; l: their distance, m. A flexible side has multipliers: the force on it, N (space
    axes), and the moment that keeps its massless frame from turning, zero.
    """

    recorded: ClassVar[tuple[str, str]] = ("tension", "N")

    stiffness: float = Field(default=0.0, ge=0.0)
    """Stiffness, N/m."""
    damping: float = Field(default=0.0, ge=0.0)
    """Damping, N s/m."""
    length: NumberOrFunction | None = None
    """Length of the relaxed spring, m; the distance at the start when not given."""
    force: NumberOrFunction | None = None
    """Additional force, N; positive pulls the two points together."""
    ground: Vector | None = None
    """Point of the ground, m (space axes), if one side is `ground`; the origin when not given."""

    @model_validator(mode="after")
    def _acts(self) -> Self:
        if not self.stiffness and not self.damping and self.force is None:
            raise ValueError("it does nothing: give a stiffness, a damping or a force")
        return self

    def item(self, own: Side, other: Side, first: bool) -> RelativeItem:
        """The spring between the two points; which side is the first does not matter. InputError
        for points that coincide at the start. Force stiffness l + damping l' + drive(t), with drive
        = force - stiffness length - damping length', on the left-hand side of the equations."""
        base, place = self._base(other), self._place(other)
        start = float(np.linalg.norm(own.place() - place))
        if not start > 1e-12 * size_of(own, other):
            raise InputError("the two points coincide at the start, so the line between them has "
                             "no direction: move a body or choose other points", "between")
        drive = Drive.of(
            self.stiffness, self.damping, offset=start if self.length is None else 0.0,
            rest=self.length, load=self.force)
        return RelativeItem(Length(*unknowns(other), own.point, base),
                            linear(self.stiffness, self.damping), drive=drive)

    def _base(self, other: Side) -> FloatArray:
        """(d,) point of the other side in its axes."""
        if other.body is not None:
            if self.ground is not None:
                raise InputError("no side is `ground`: drop it", "ground")
            return other.point
        given = (0.0,) * other.d if self.ground is None else self.ground
        if len(given) != other.d:
            raise InputError(f"give {other.d} components (got {list(given)})", "ground")
        return np.array(given, dtype=np.float64)

    def _place(self, other: Side) -> FloatArray:
        """(d,) initial position of the other point, m, space axes."""
        return other.place() if other.body is not None else self._base(other)


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

    def item(self, own: Side, other: Side, first: bool) -> RelativeItem:
        """The spring about the axis. A prescribed rest angle is part of the drive in the plane; in
        space the angle is measured from it (`relaxed`), as it is known but for two turns. first:
        True if `own` is the first side of the scene; moments are on the left-hand side of the
        equations, hence the minus sign of the torque."""
        # item: acts against the angle of `own`, that of the first side times `sign`
        sign, law = 1.0 if first else -1.0, linear(self.stiffness, self.damping)
        drive = Drive.of(
            self.stiffness, self.damping, offset=0.0, rest=self.angle, load=self.torque, sign=sign,
            factor=-sign)
        if own.d == 2:
            if self.axis is not None:
                raise InputError("plane bodies turn about the normal of the plane: drop it", "axis")
            return RelativeItem(relative_angle(np.zeros(2), own, other), law, drive=drive)
        relaxed = None  # sign angle(t), as the drive of a stiffness of -1
        if self.angle is not None:
            relaxed = replace(drive, stiffness=-1.0, damping=0.0, load=None)
        return RelativeItem(
            relative_angle(unit(self.axis, 3), own, other), law,
            drive=replace(drive, stiffness=0.0), relaxed=relaxed)
