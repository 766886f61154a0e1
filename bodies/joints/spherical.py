"""Spherical joint: two points in space coincide, all rotations are free."""

from collections.abc import Mapping

from sparsemor.bodies.joints.sides import need_space
from sparsemor.bodies.joints.space import rows_between
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part


class Spherical(Plugin):
    """The mean points of two sets coincide, or one stays where it is. In the plane: `revolute`.

    Three multipliers: the force on the first side, N (space axes).
    """

    between: tuple[str, str]
    """Two of `body:set` and `ground`."""

    def build(self, name: str, parts: Mapping[str, Part]) -> SpaceJoint:
        need_space(parts, self.between, "spherical")
        rows = rows_between(name, self.between, parts, meeting=True, turning=False)
        rows.meet()
        return rows.joint()
