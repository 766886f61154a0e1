"""Quantities that are prescribed instead of solved for while a model is assembled."""

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
    """Base of prescribed quantities; it prescribes nothing.

    Each method is called once a part while the model is assembled; None: it is solved for.
    InputError where a part lacks an ability that is needed.
    """

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        """Motion of a body, which then has no rigid unknowns."""
        return None

    def reactions(self, name: str, joint: Joint) -> Table | None:
        """A joint's forces, N and N m, as its `known` takes them, which then are prescribed."""
        return None

    def motion(self, bodies: Mapping[str, Body]) -> Mapping[str, FrameHistory] | None:
        """Motion of every body, where contacts follow it instead of the unknowns."""
        return None

    def surface_loads(
        self, name: str, contact: Contact, motion: Mapping[str, FrameHistory]
    ) -> Mapping[str, SurfaceLoads]:
        """Loads of a contact on its surfaces along the motion, by body."""
        return importing(contact, name).imported(motion)


NOTHING = PrescribedQuantities()


class Immobile(PrescribedQuantities):
    """For the rigid stage itself: bodies that lose their fields and do not move take part as they
    are, so that forces on them are no mistake."""

    def frame(self, name: str, body: Body) -> FrameHistory | None:
        able = following(body)
        return FrameHistory.standing(able.pose) if able.immobile else None


class AtStart(PrescribedQuantities):
    """Everything as it is at the start, no reactions: to check a scene before its rigid stage."""

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
    """The histories of a stage, contacts evaluated along its motion."""

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
    """The body, if its motion can be prescribed."""
    if isinstance(body, FollowsMotion):
        return body
    raise PRESCRIBED_MOTION.refusal(body)


def prescribable(joint: Joint) -> PrescribesReactions:
    """The joint, if its reactions can be prescribed."""
    if isinstance(joint, PrescribesReactions):
        return joint
    raise PRESCRIBED_REACTIONS.refusal(joint)


def importing(contact: Contact, name: str) -> ImportsMotion:
    """The contact of this name, if it can be evaluated along a prescribed motion."""
    if isinstance(contact, ImportsMotion):
        return contact
    raise CONTACT_ALONG_MOTION.refusal(contact, f"contacts.{name}")


def carrying(body: Body) -> CarriesSurfaceLoads:
    """The body, if it takes tabulated loads on its surface."""
    if isinstance(body, CarriesSurfaceLoads):
        return body
    raise SURFACE_LOADS.refusal(body, f"bodies.{body.name}")
