"""Histories of a rigid stage that the flexible one follows: motion, reactions, surface loads."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.load_tables import blended, place
from sparsemor.core.protocols.poses import unit_attitude


@dataclass(frozen=True, slots=True, eq=False)
class FrameHistory:
    """The motion of one body frame at increasing `times` (T,), s.

    pose (T, n): position of the origin (m), then angle (rad) or unit quaternion (`poses`: n = 3, 4
    or 7); rate, acceleration (T, n): its rates as the integrator gave them, which are not
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
    or "area" m2 in contact, "pressure" Pa, the largest) -> (T,). reactions_passed_on: joint -> what
    its `known` takes, (T, columns), where that is not the multipliers.
    """

    times: FloatArray
    frames: Mapping[str, FrameHistory]
    moves: frozenset[str]
    reactions: Mapping[str, FloatArray]
    contacts: Mapping[str, Mapping[str, FloatArray]]
    reactions_passed_on: Mapping[str, FloatArray] = field(default_factory=dict)
