"""Revolute joint: two attachment points coincide, and in space an axis is shared."""

from collections.abc import Mapping

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.conditions import rows_between
from sparsemor.bodies.joints.plane_attachment import connect
from sparsemor.bodies.joints.plane_part import JointPart
from sparsemor.bodies.joints.space_attachment import spatial, unit
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.core import InputError, Part, Plugin


class Revolute(Plugin):
    """Revolute joint: the mean points of two sets coincide; rotation about the axis is free.

    With one set, its mean point is fixed in space. In the plane the axis is normal to it.

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
