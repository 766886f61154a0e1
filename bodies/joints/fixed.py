"""Fixed joint: two attachments keep their relative position and angle."""

from collections.abc import Mapping

from sparsemor.bodies.joints.between import connect
from sparsemor.bodies.joints.part import JointPart
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part


class Fixed(Plugin):
    """The mean points coincide and the mean rotations of the two sets keep their difference.

    Three multipliers: force on the first side (N, space axes) and moment (N m).
    """

    between: tuple[str, str]
    """Two of `body:set` and `ground`."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        return connect(name, self.between, parts, angle=True)
