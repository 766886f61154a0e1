"""Motion, joint reactions and contact loads that are prescribed rather than solved for."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core.model.optional_features import CONTACT_ALONG_MOTION, PRESCRIBED_MOTION
from sparsemor.core.protocols.body import Body
from sparsemor.core.protocols.contact import Contact
from sparsemor.core.protocols.joint import Joint
from sparsemor.core.protocols.load_tables import Table
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage, SurfaceLoads


class PrescribedQuantities:
    """Base class for prescribed motion, reactions and surface loads. The default prescribes
    nothing.

    Each method is called once per body, joint or contact during assembly; None means that the
    quantity is solved for. InputError is raised for an object that does not support it.
    """

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        """Motion of a body's frame, which then has no rigid unknowns."""
        return None

    def reactions(self, name: str, joint: Joint) -> Table | None:
        """Prescribed reaction forces and moments of a joint over time, N and N m, in the columns
        that `Joint.known` takes."""
        return None

    def motion(self, bodies: Mapping[str, Body]) -> Mapping[str, FrameHistory] | None:
        """Prescribed motion of all bodies along which contacts are evaluated, or None."""
        return None

    def surface_loads(
        self, name: str, contact: Contact, motion: Mapping[str, FrameHistory]
    ) -> Mapping[str, SurfaceLoads]:
        """Surface loads of a contact along the prescribed motion, by body."""
        return loads_along(contact, motion)


NOTHING = PrescribedQuantities()


class Immobile(PrescribedQuantities):
    """Prescribed poses of the fixed bodies in a rigid-body pre-simulation, so that forces on them
    are accepted."""

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        return FrameHistory.standing(body.pose) if body.immobile else None


class AtStart(PrescribedQuantities):
    """All bodies fixed at their initial pose with zero reactions: used to check the input before a
    rigid-body pre-simulation."""

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        motion = FrameHistory.standing(body.pose)
        PRESCRIBED_MOTION.checked(body.with_motion(motion), body)
        return motion if body.moves else None

    def reactions(self, name: str, joint: Joint) -> Table | None:
        if not sum(block.size for block in joint.blocks()):
            return None
        return Table(np.zeros(1), np.zeros((1, joint.reaction_count)))

    def motion(self, bodies: Mapping[str, Body]) -> Mapping[str, FrameHistory] | None:
        return {n: FrameHistory.standing(b.pose) for n, b in bodies.items()}


class Followed(PrescribedQuantities):
    """Motion and reactions of a rigid-body pre-simulation; contacts are evaluated along this
    motion."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        return self.stage.frames[name] if name in self.stage.moves else None

    def reactions(self, name: str, joint: Joint) -> Table | None:
        # (T, columns): what the joint computed from its multipliers (`Joint.reactions_passed_on`),
        # else the multipliers themselves
        forces = self.stage.reactions_passed_on.get(name, self.stage.reactions.get(name))
        return None if forces is None else Table(self.stage.times, forces)

    def motion(self, bodies: Mapping[str, Body]) -> Mapping[str, FrameHistory] | None:
        return self.stage.frames


def loads_along(
    contact: Contact, motion: Mapping[str, FrameHistory]
) -> Mapping[str, SurfaceLoads]:
    """Surface loads of a contact along a prescribed motion, by body; InputError if it cannot be
    evaluated so."""
    return CONTACT_ALONG_MOTION.checked(
        contact.imported(motion), contact, f"contacts.{contact.name}")
