"""Motion, joint reactions and surface loads of a rigid-body pre-simulation, which are prescribed in
the flexible simulation that follows."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols.load_tables import blended, place, places
from sparsemor.core.protocols.poses import unit_attitude


@dataclass(frozen=True, slots=True, eq=False)
class FrameHistory:
    """Motion of one body frame at increasing times (T,), s.

    pose (T, n): position of the origin (m), then angle (rad) or unit quaternion (n = 3, 4 or 7, see
    `poses`); rate, acceleration (T, n): its time derivatives as computed by the integrator,
    therefore consistent only to its accuracy.
    """

    times: FloatArray
    pose: FloatArray
    rate: FloatArray
    acceleration: FloatArray

    @classmethod
    def standing(cls, pose: FloatArray, times: FloatArray | None = None) -> "FrameHistory":
        """Motion of a frame that stays at a pose (n,)."""
        t = np.zeros(1) if times is None else times
        still = np.zeros((len(t), len(pose)))
        return cls(t, still + pose, still, still)

    def at(self, t: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pose, rate and acceleration (n,) at t, s: exact at tabulated times, linear between them
        (quaternions normalised), constant outside."""
        i, w = place(self.times, t)
        return (unit_attitude(blended(self.pose, i, w)) if w else self.pose[i],
                blended(self.rate, i, w), blended(self.acceleration, i, w))

    def along(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pose, rate and acceleration (T, n) at times (T,), s; at the tabulated times the arrays
        themselves, not copies."""
        if np.array_equal(times, self.times):
            return self.pose, self.rate, self.acceleration
        i, w = places(self.times, times)
        if not w.any():
            return self.pose[i], self.rate[i], self.acceleration[i]
        pose, rate, acceleration = zip(*(self.at(t) for t in times.tolist()), strict=True)
        return np.stack(pose), np.stack(rate), np.stack(acceleration)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceLoads:
    """Nodal loads on the surface of one body at the times of a prescribed motion.

    nodes (j,); force (T, j, d): consistent nodal forces in body axes, N; heat (T, j), W.
    """

    nodes: IntArray
    force: FloatArray
    heat: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """Results of a rigid-body pre-simulation at times (T,), s, including the initial time.

    frames: motion of every body; moves: names of the moving bodies; reactions: joint -> multipliers
    (T, l), N and N m; contacts: contact -> resultant ("normal" N, "friction" N, "power" W, "length"
    m or "area" m2 in contact, largest "pressure" Pa) -> (T,). reactions_passed_on: joint ->
    reactions (T, columns) for joints whose prescribed reactions differ from their multipliers.
    dropped: largest initial acceleration that its first step did without, m/s2 or rad/s2 (0: none).
    components: joint -> name and unit of each multiplier.
    """

    times: FloatArray
    frames: Mapping[str, FrameHistory]
    moves: frozenset[str]
    reactions: Mapping[str, FloatArray]
    contacts: Mapping[str, Mapping[str, FloatArray]]
    reactions_passed_on: Mapping[str, FloatArray] = field(default_factory=dict)
    dropped: float = 0.0
    components: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
