"""Motion, joint reactions and contact loads that are prescribed rather than solved for."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core.model.features import (
    CONTACT_ALONG_MOTION,
    PRESCRIBED_MOTION,
    PRESCRIBED_REACTIONS,
    SURFACE_LOADS,
)
from sparsemor.core.protocols import (
    Body,
    CarriesSurfaceLoads,
    Contact,
    FollowsMotion,
    HasPose,
    ImportsMotion,
    Joint,
    PassesReactionsOn,
    PrescribesReactions,
)
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
        that `PrescribesReactions.known` takes."""
        return None

    def motion(self, bodies: Mapping[str, Body]) -> Mapping[str, FrameHistory] | None:
        """Prescribed motion of all bodies along which contacts are evaluated, or None."""
        return None

    def surface_loads(
        self, name: str, contact: Contact, motion: Mapping[str, FrameHistory]
    ) -> Mapping[str, SurfaceLoads]:
        """Surface loads of a contact along the prescribed motion, by body."""
        return importing(contact, name).imported(motion)


NOTHING = PrescribedQuantities()


class Immobile(PrescribedQuantities):
    """Prescribed poses of the fixed bodies in a rigid-body pre-simulation, so that forces on them
    are accepted."""

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        able = following(body)
        return FrameHistory.standing(able.pose) if able.immobile else None


class AtStart(PrescribedQuantities):
    """All bodies fixed at their initial pose with zero reactions: used to check the input before a
    rigid-body pre-simulation."""

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        able = following(body)
        return FrameHistory.standing(able.pose) if able.moves else None

    def reactions(self, name: str, joint: Joint) -> Table | None:
        size = sum(block.size for block in joint.blocks())
        if not size:
            return None
        prescribable(joint)
        columns = joint.reaction_count if isinstance(joint, PassesReactionsOn) else size
        return Table(np.zeros(1), np.zeros((1, columns)))

    def motion(self, bodies: Mapping[str, Body]) -> Mapping[str, FrameHistory] | None:
        return {n: FrameHistory.standing(b.pose) for n, b in bodies.items()
                if isinstance(b, HasPose)}


class Followed(PrescribedQuantities):
    """Motion and reactions of a rigid-body pre-simulation; contacts are evaluated along this
    motion."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        return self.stage.frames[name] if name in self.stage.moves else None

    def reactions(self, name: str, joint: Joint) -> Table | None:
        forces = self.stage.reactions_passed_on.get(name, self.stage.reactions.get(name))
        return None if forces is None else Table(self.stage.times, forces)

    def motion(self, bodies: Mapping[str, Body]) -> Mapping[str, FrameHistory] | None:
        return self.stage.frames


def following(body: Body) -> FollowsMotion:
    """The body as one whose motion can be prescribed; InputError if it cannot."""
    if isinstance(body, FollowsMotion):
        return body
    raise PRESCRIBED_MOTION.refusal(body)


def prescribable(joint: Joint) -> PrescribesReactions:
    """The joint as one whose reactions can be prescribed; InputError if they cannot."""
    if isinstance(joint, PrescribesReactions):
        return joint
    raise PRESCRIBED_REACTIONS.refusal(joint)


def importing(contact: Contact, name: str) -> ImportsMotion:
    """The contact `name` as one that can be evaluated along a prescribed motion; InputError if it
    cannot."""
    if isinstance(contact, ImportsMotion):
        return contact
    raise CONTACT_ALONG_MOTION.refusal(contact, f"contacts.{name}")


def carrying(body: Body) -> CarriesSurfaceLoads:
    """The body as one that accepts time-tabulated surface loads; InputError if it does not."""
    if isinstance(body, CarriesSurfaceLoads):
        return body
    raise SURFACE_LOADS.refusal(body, f"bodies.{body.name}")
