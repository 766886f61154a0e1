"""Gears: two bodies that turn with a constant ratio."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.frames.transmission import Transmission, Turned
from sparsemor.bodies.joints.conditions import conditions_between
from sparsemor.bodies.joints.part import JointPart
from sparsemor.bodies.joints.side import Side, unit
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
            turned(own, axis), turned(other, second), (float(n1), float(n2)), 1.0 / n1,
            len(other.pose)), other.reads)
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


