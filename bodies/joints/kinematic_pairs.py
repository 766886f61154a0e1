"""Joints of points and directions of two sides, and their base class: fixed, spherical, revolute,
cylindrical, prismatic and universal.

Their rows are those of constraint_conditions.py: `meet`, `face`, `slide` and `no_turn`.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.initial_pose import Vector
from sparsemor.bodies.joints.built_joint import JointPart
from sparsemor.bodies.joints.constraint_conditions import Conditions, conditions_between
from sparsemor.bodies.joints.joint_heat import heat_exchange
from sparsemor.bodies.joints.joint_sides import unit
from sparsemor.core import InputError, JointPlugin, Part


class Between(JointPlugin):
    """Base class of joints between two of `body:set` and `ground`.

    dimensions: dimensions in which the joint exists, 2 in the plane and 3 in space; relative:
    dimensions in which it constrains directions or lines, for which two flexible sides need an
    intermediate massless frame.
    """

    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    relative: ClassVar[tuple[int, ...]] = ()

    between: tuple[str, str]
    """The two sides of the joint: each a set `body:set`, or `ground`."""
    conductance: float | None = Field(default=None, ge=0.0)
    """Thermal conductance G, W/K, of a joint of two bodies with temperatures: the heat flow is
    G (T_1 - T_2), T_i the mean temperatures of the sets. No heat flows for 0, or when not given,
    which is noted."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        conditions = conditions_between(name, self.between, parts, dimensions=self.dimensions,
                                        relative=self.relative)
        self.constrain(conditions)
        exchange, notes = heat_exchange(name, conditions.ends, self.conductance, parts)
        return replace(conditions.joint(), exchange=exchange, notes=notes)

    @abstractmethod
    def constrain(self, sides: Conditions) -> None:
        """Adds the constraints of the joint."""


class Fixed(Between):
    """Fixed joint: the centres of two sets coincide and their relative rotation is constant.

    Multipliers: force on the first side (N, space axes) and moment (N m); in space three moments,
    about axes that coincide with the space axes at the start and rotate with the bodies.
    """

    relative = (3,)  # in space it constrains directions (`Between`)

    def constrain(self, sides: Conditions) -> None:
        sides.meet()
        sides.no_turn()


class Spherical(Between):
    """Spherical joint: the centres of two sets coincide, or one is fixed in space.

    In the plane: `revolute`.

    Three multipliers: the force on the first side, N (space axes).
    """

    dimensions = (3,)  # it exists in space alone

    def constrain(self, sides: Conditions) -> None:
        sides.meet()


class Revolute(Between):
    """Revolute joint: the centres of two sets coincide; rotation about the axis is free.

    With one set, its centre is fixed in space. In the plane the axis is normal to it.

    Multipliers: the force on the first side, N (space axes); in space two moments perpendicular to
    the axis, N m.
    """

    relative = (3,)  # in space it constrains directions (`Between`)

    axis: tuple[float, float, float] | None = None
    """In space: direction of the axis at the start (space axes)."""

    def constrain(self, sides: Conditions) -> None:
        if sides.d == 2 and self.axis is not None:
            raise InputError("plane bodies turn about the normal of the plane: drop it", "axis")
        axis = None if sides.d == 2 else unit(self.axis, 3)
        sides.meet()
        if axis is not None:  # the axis of the own side stays normal to two directions of the other
            sides.face([axis, axis], across(axis))


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
        sides.slide(across(axis))  # across: two unit vectors normal to the axis
        sides.face([axis, axis], across(axis))


class Prismatic(Between):
    """Prismatic joint: relative translation along an axis fixed in one body, no relative rotation.

    The axis is fixed in the second body or the ground; in the first, if only the second is
    flexible; in a frame that moves with the first set, if both are.

    Multipliers: the forces on the first side perpendicular to the axis (two in space, one in the
    plane), N, and the moments (three in space, one in the plane), N m.
    """

    relative = (2, 3)  # in both dimensions it constrains lines (`Between`)

    axis: Vector
    """Direction of the axis at the start (space axes): two numbers in the plane, three in space."""

    def constrain(self, sides: Conditions) -> None:
        sides.slide(across(unit(self.axis, sides.d)))  # across: unit vectors normal to the axis
        sides.no_turn()


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
        # a pair of directions: of the side that evaluates it (`own`), then of the other one
        own, other = (one, two) if sides.own is sides.first else (two, one)
        sides.face([own], [other])
