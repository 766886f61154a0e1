"""What a rigid stage hands to the flexible one: motion, reactions and surface loads."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.placement import unit_attitude
from sparsemor.core.tables import Table, blended, place


@dataclass(frozen=True, slots=True, eq=False)
class FrameHistory:
    """The motion of one body frame at increasing `times` (T,), s.

    pose (T, n): position of the origin (m), then angle (rad) or unit quaternion (core/placement.py:
    n = 3, 4 or 7); rate, acceleration (T, n): its rates as the integrator gave them, which are not
    derivatives of one another to round-off.
    """

    times: FloatArray
    pose: FloatArray
    rate: FloatArray
    acceleration: FloatArray

    @classmethod
    def standing(cls, pose: FloatArray, times: FloatArray | None = None) -> "FrameHistory":
        """A frame that stays at pose (n,)."""
        t = np.zeros(1) if times is None else times
        still = np.zeros((len(t), len(pose)))
        return cls(t, still + pose, still, still)

    def at(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(n,) pose, rate and acceleration at t, s: those of the table at a tabled time, on a
        straight line between two (quaternions brought back to length 1), constant outside."""
        i, w = place(self.times, t)
        return (unit_attitude(blended(self.pose, i, w)) if w else self.pose[i],
                blended(self.rate, i, w), blended(self.acceleration, i, w))

    def along(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(T, n) each: the same at times (T,), s; at its own times the tables, not copies."""
        if np.array_equal(times, self.times):
            return self.pose, self.rate, self.acceleration
        pose, rate, acceleration = zip(*(self.at(t) for t in times.tolist()), strict=True)
        return np.stack(pose), np.stack(rate), np.stack(acceleration)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceLoads:
    """Loads on the points of one body's surface at the times of the motion they were made from.

    nodes (j,); force (T, j, d): consistent nodal forces in body axes, N; heat (T, j), W.
    """

    nodes: IntArray
    force: FloatArray
    heat: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """Histories of a rigid stage at its times (T,), s, the start first.

    frames: of every body; moves: which of them move; reactions: joint -> (T, l) multipliers, N and
    N m; contacts: contact -> name of a history ("normal" N, "friction" N, "power" W, "length" m
    or "area" m2 in contact, "pressure" Pa, the largest) -> (T,). handed: joint -> what its
    `known` takes, (T, columns), where that is not the multipliers.
    """

    times: FloatArray
    frames: Mapping[str, FrameHistory]
    moves: frozenset[str]
    reactions: Mapping[str, FloatArray]
    contacts: Mapping[str, Mapping[str, FloatArray]]
    handed: Mapping[str, FloatArray] = field(default_factory=dict)


class Given:
    """What a model is told instead of solving for it; by itself nothing.

    Each method is asked once a part while the model is assembled; None: it is solved for.
    """

    def frame(self, name: str, body: Any) -> FrameHistory | None:
        """How a body moves, which then has no rigid unknowns."""
        return None

    def reactions(self, name: str, joint: Any) -> Table | None:
        """A joint's forces, N and N m, as its `known` takes them, which then are given."""
        return None

    def motion(self, bodies: Mapping[str, Any]) -> Mapping[str, FrameHistory] | None:
        """How every body moves, where contacts follow that motion instead of the unknowns."""
        return None

    def surface_loads(
        self, name: str, contact: Any, motion: Mapping[str, FrameHistory]
    ) -> Mapping[str, SurfaceLoads]:
        """What a contact does to its surfaces along the motion, by body."""
        loads: Mapping[str, SurfaceLoads] = contact.imported(motion)
        return loads


NOTHING = Given()


class Idle(Given):
    """For the rigid stage itself: bodies that lose their fields and do not move take part as they
    are, so that forces on them are no mistake."""

    def frame(self, name: str, body: Any) -> FrameHistory | None:
        return FrameHistory.standing(body.pose) if body.idle else None


class AtStart(Given):
    """Everything as it is at the start, no reactions: to check a scene before its rigid stage."""

    def frame(self, name: str, body: Any) -> FrameHistory | None:
        return FrameHistory.standing(body.pose) if body.moves else None

    def reactions(self, name: str, joint: Any) -> Table | None:
        size = sum(block.size for block in joint.blocks())
        columns = getattr(joint, "handed", size)
        return Table(np.zeros(1), np.zeros((1, columns))) if size else None

    def motion(self, bodies: Mapping[str, Any]) -> Mapping[str, FrameHistory] | None:
        return {n: FrameHistory.standing(b.pose) for n, b in bodies.items()}


class Followed(Given):
    """The histories of a stage, contacts imported from its motion."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage

    def frame(self, name: str, body: Any) -> FrameHistory | None:
        return self.stage.frames[name] if name in self.stage.moves else None

    def reactions(self, name: str, joint: Any) -> Table | None:
        known = self.stage.handed.get(name, self.stage.reactions.get(name))
        return None if known is None else Table(self.stage.times, known)

    def motion(self, bodies: Mapping[str, Any]) -> Mapping[str, FrameHistory] | None:
        return self.stage.frames
