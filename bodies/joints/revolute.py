"""Revolute joint: two attachment points coincide, and in space an axis is shared."""

from collections.abc import Mapping

from sparsemor.bodies.joints.between import connect
from sparsemor.bodies.joints.part import JointPart
from sparsemor.bodies.joints.sides import spatial, unit
from sparsemor.bodies.joints.space import rows_between
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.bodies.spatial.rotation import across
from sparsemor.core.errors import InputError
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part


class Revolute(Plugin):
    """The mean points of two sets coincide (or one stays in space); rotation about the axis is
    free. In the plane the axis is normal to it.

    Multipliers: the force on the first side, N (space axes); in space two moments across the axis,
    N m.
    """

    between: tuple[str, str]
    """Two of `body:set` and `ground`."""
    axis: tuple[float, float, float] | None = None
    """In space: direction of the axis at the start (space axes)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart | SpaceJoint:
        if not spatial(parts, self.between):
            if self.axis is not None:
                raise InputError("plane bodies turn about the normal of the plane: drop it", "axis")
            return connect(name, self.between, parts, angle=False)
        axis = unit(self.axis)
        rows = rows_between(name, self.between, parts, meeting=True, turning=True)
        rows.meet()
        rows.face([axis, axis], across(axis))
        return rows.joint()
