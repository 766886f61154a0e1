"""Fixed joint: two attachments keep their relative position and rotation."""

from collections.abc import Mapping

from sparsemor.bodies.joints.conditions import rows_between
from sparsemor.bodies.joints.plane_attachment import connect
from sparsemor.bodies.joints.plane_part import JointPart
from sparsemor.bodies.joints.space_attachment import spatial
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.core import Part, Plugin


class Fixed(Plugin):
    """Fixed joint: the mean points of two sets coincide and their relative rotation is constant.

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
