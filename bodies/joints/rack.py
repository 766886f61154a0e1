"""Rack and pinion: a body that turns and one that moves along a line."""

from collections.abc import Mapping

import numpy as np
from pydantic import Field

from sparsemor.bodies.frames.transmission import Shifted, Transmission
from sparsemor.bodies.joints.conditions import conditions_between, constant
from sparsemor.bodies.joints.gear import rigid_pair, turned
from sparsemor.bodies.joints.part import JointPart
from sparsemor.bodies.joints.side import unit
from sparsemor.bodies.pose import Vector
from sparsemor.core import InputError, JointPlugin, Part


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
            (-1.0, 1.0 / self.radius), self.radius, len(other.pose), "N"), other.reads)
        return sides.joint()
