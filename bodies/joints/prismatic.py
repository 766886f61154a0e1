"""Prismatic joint: one direction of translation in space, no rotation."""

from collections.abc import Mapping

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.conditions import rows_between
from sparsemor.bodies.joints.space_attachment import need_space, unit
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.core import Part, Plugin


class Prismatic(Plugin):
    """Prismatic joint: relative translation along an axis fixed in one body, no relative rotation.

    Five multipliers: two forces across the axis, N, and three moments, N m.
    """

    between: tuple[str, str]
    """Two of `body:set` and `ground`."""
    axis: tuple[float, float, float]
    """Direction of the axis at the start (space axes)."""

    def build(self, name: str, parts: Mapping[str, Part]) -> SpaceJoint:
        need_space(parts, self.between, "prismatic")
        rows = rows_between(name, self.between, parts, meeting=False, turning=True)
        rows.slide(across(unit(self.axis)))
        rows.no_turn()
        return rows.joint()
