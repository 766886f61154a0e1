"""Fixed joint: two attachments keep their relative position and rotation."""

from collections.abc import Mapping

from sparsemor.bodies.joints.between import connect
from sparsemor.bodies.joints.part import JointPart
from sparsemor.bodies.joints.sides import spatial
from sparsemor.bodies.joints.space import rows_between
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part


class Fixed(Plugin):
    """The mean points coincide and the mean rotations of the two sets keep their difference.

    Multipliers: force on the first side (N, space axes) and moment (N m); in space three moments,
    about axes that are those of space at the start and turn with the bodies.
    """

    between: tuple[str, str]
    """Two of `body:set` and `ground`."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart | SpaceJoint:
        if not spatial(parts, self.between):
            return connect(name, self.between, parts, angle=True)
        rows = rows_between(name, self.between, parts, meeting=True, turning=True)
        rows.meet()
        rows.no_turn()
        return rows.joint()
