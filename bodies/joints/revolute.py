"""Revolute joint: two attachment points coincide."""

from collections.abc import Mapping

from sparsemor.bodies.joints.between import connect
from sparsemor.bodies.joints.part import JointPart
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part


class Revolute(Plugin):
    """The mean points of two sets coincide (or one stays in space); rotation is free.

    Two multipliers: the force on the first side, N (space axes).
    """

    between: tuple[str, str]
    """Two of `body:set` and `ground`."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        return connect(name, self.between, parts, angle=False)
