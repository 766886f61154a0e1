"""Cylindrical joint: translation along an axis in space and rotation about it."""

from collections.abc import Mapping

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.conditions import rows_between
from sparsemor.bodies.joints.space_attachment import need_space, unit
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.core import Part, Plugin


class Cylindrical(Plugin):
    """Cylindrical joint: rotation about and translation along one axis that both bodies share.

    Four multipliers: two forces across the axis, N, and two moments, N m.
    """

    between: tuple[str, str]
    """Two of `body:set` and `ground`."""
    axis: tuple[float, float, float]
    """Direction of the axis at the start (space axes)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> SpaceJoint:
        need_space(parts, self.between, "cylindrical")
        axis = unit(self.axis)
        rows = rows_between(name, self.between, parts, meeting=False, turning=True)
        rows.slide(across(axis))
        rows.face([axis, axis], across(axis))
        return rows.joint()
