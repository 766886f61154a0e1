"""Gears, two bodies that turn with a constant ratio, and rack and pinion, a body that turns and one
that moves along a line."""

from collections.abc import Mapping

import numpy as np
from pydantic import Field

from sparsemor.bodies.frames.constraints import Shifted, Transmission, Turned
from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.initial_pose import Vector
from sparsemor.bodies.joints.built_joint import JointPart
from sparsemor.bodies.joints.constraint_conditions import conditions_between, constant
from sparsemor.bodies.joints.joint_sides import Side, unit
from sparsemor.core import FloatArray, InputError, JointPlugin, Part


class Gear(JointPlugin):
    """Pair of gears: teeth_1 angle_1 + teeth_2 angle_2 keeps its value; with the other sign if one
    has internal teeth.

    In space the angles are those about axes that are fixed there, one for each gear, and the sides
    are rigid bodies. Revolute joints hold the gears; the pressure angle and the forces between the
    teeth are left out. One multiplier: the moment on the first gear, N m.
    """

    between: tuple[str, str]
    """The two gears: each a set `body:set`."""
    teeth: tuple[int, int]
    """Numbers of teeth of both; only their ratio matters."""
    internal: bool = False
    """True where one gear has internal teeth, so that both turn in the same direction."""
    axis: tuple[float, float, float] | None = None
    """In space: axis of the first gear (space axes), about which angles count."""
    second_axis: tuple[float, float, float] | None = None
    """In space: axis of the second gear, that of the first one if not given; another direction for
    bevel gears."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        """The gear: in the plane a linear constraint of both angles, angle_1 + n2 / n1 angle_2, in
        space (n1 angle_1 + n2 angle_2) / n1 = 0 of angles about the axes since the start
        (`turned`), of two rigid bodies (`rigid_pair`); n2 is negative for internal teeth."""
        if min(self.teeth) < 1:
            raise InputError(f"give numbers of teeth of 1 or more (got {list(self.teeth)})",
                             "teeth")
        sides = conditions_between(name, self.between, parts)
        n1, n2 = self.teeth[0], -self.teeth[1] if self.internal else self.teeth[1]
        if any(s.body is None for s in (sides.first, sides.second)):
            raise InputError("a gear meshes with another one: the ground is none", "between")
        if sides.d == 2:
            for key in ("axis", "second_axis"):
                if getattr(self, key) is not None:
                    raise InputError("plane bodies turn about the normal of the plane: drop it",
                                     key)
            sides.couple_rotations(n2 / n1)
            return sides.joint()
        own, other = rigid_pair(sides.first, sides.second)
        axis = unit(self.axis, 3)
        second = axis if self.second_axis is None else unit(self.second_axis, 3, "second_axis")
        sides.add_item(own, Transmission(
            turned(own, axis), turned(other, second), factors=(float(n1), float(n2)),
            scale=1.0 / n1, others=len(other.pose)), other.reads)
        return sides.joint()


def rigid_pair(own: Side, other: Side) -> tuple[Side, Side]:
    """The sides of a gear in space. InputError unless both are rigid bodies that can move."""
    for side in (own, other):
        if side.flexible or not side.reads:
            raise InputError("in space both sides are rigid bodies that can move: weld a rigid hub "
                             "to a flexible one", side.key)
    return own, other


def turned(side: Side, axis: FloatArray) -> Turned:
    """Angle of a side about an axis (3,) of space since the start."""
    e1, e2 = across(axis)
    return Turned(e1 @ side.axes, np.asarray(e1), np.asarray(e2))


class Rack(JointPlugin):
    """Rack and pinion: the rack moves by radius times the angle of the pinion along a line that is
    fixed in space.

    Joints hold the pinion at its place and the rack on its line. In space the sides are rigid
    bodies. One multiplier: the force on the rack along the line, N.
    """

    between: tuple[str, str]
    """Pinion and rack, in this order: each a set `body:set`."""
    radius: float = Field(gt=0.0)
    """Pitch radius of the pinion, m."""
    direction: Vector
    """Direction in which the rack moves where the pinion turns counterclockwise (in space about
    `axis`)."""
    axis: tuple[float, float, float] | None = None
    """In space: axis of the pinion (space axes)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        """The rack: the way of the rack is the angle of the pinion times its radius, a constraint
        way - radius angle = 0 (in the plane with the values at the start on the right-hand side),
        so that its multiplier is a force on the rack."""
        sides = conditions_between(name, self.between, parts)
        pinion, rack = sides.first, sides.second
        if pinion.body is None or rack.body is None:
            raise InputError("a pinion meshes with a rack: the ground is none", "between")
        e = unit(self.direction, sides.d, "direction")
        start = float(rack.place() @ e)
        if sides.d == 2:
            if self.axis is not None:
                raise InputError("plane bodies turn about the normal of the plane: drop it", "axis")
            sides.linear(
                [(rack, np.array([[*e, 0.0]])), (pinion, np.array([[0.0, 0.0, -self.radius]]))],
                [constant(start - self.radius * float(pinion.pose[2]))])
            return sides.joint()
        own, other = rigid_pair(pinion, rack)
        sides.add_item(own, Transmission(
            turned(own, unit(self.axis, 3)), Shifted(other.point, e, start),
            factors=(-1.0, 1.0 / self.radius), scale=self.radius, others=len(other.pose),
            unit="N"), other.reads)
        return sides.joint()
