"""Spherical joint: two points in space coincide, all rotations are free."""

from collections.abc import Mapping

from sparsemor.bodies.joints.conditions import rows_between
from sparsemor.bodies.joints.space_attachment import need_space
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.core import Part, Plugin


class Spherical(Plugin):
    """Spherical joint: the mean points of two sets coincide, or one is fixed in space.

    In the plane: `revolute`.

    Three multipliers: the force on the first side, N (space axes).
    """

    between: tuple[str, str]
    """Two of `body:set` and `ground`."""

    def build(self, name: str, parts: Mapping[str, Part]) -> SpaceJoint:
        need_space(parts, self.between, "spherical")
        rows = rows_between(name, self.between, parts, meeting=True, turning=False)
        rows.meet()
        return rows.joint()
