"""Rigid surfaces along a known motion, seen from the second body's axes."""

import numpy as np

from sparsemor.bodies.contact.part import Motion
from sparsemor.bodies.contact.spatial.surface import Surface
from sparsemor.bodies.spatial.attitude import attitude
from sparsemor.core.arrays import FloatArray


class Path:
    """Frame of one body at all times: origin R and its velocity (T, 3), A (T, 3, 3), angular
    velocity w (T, 3) in body axes, rad/s. One row for all times where the body stands still."""

    def __init__(self, surface: Surface, motion: Motion) -> None:
        history = motion.get(surface.body.name)
        pose = surface.body.pose[None] if history is None else history.pose
        rate = np.zeros_like(pose) if history is None else history.rate
        if not rate.any() and not np.diff(pose, axis=0).any():
            pose, rate = pose[:1], rate[:1]
        turns = [attitude(q / np.linalg.norm(q) if len(q) == 4 else q) for q in pose[:, 3:]]
        self.R, self.R1 = pose[:, :3], rate[:, :3]
        self.A = np.stack([turn.A for turn in turns])
        self.w = np.stack([turn.rates(v, v, 0.0, 0.0)[0]
                           for turn, v in zip(turns, rate[:, 3:], strict=True)])

    def at(self, now: slice) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """R, R1, A, w of some of the times."""
        now = now if len(self.R) > 1 else slice(0, 1)
        return self.R[now], self.R1[now], self.A[now], self.w[now]


def seen(first: Path, second: Path, X: FloatArray, now: slice) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities (T, n, 3) of the first body's points X (n, 3), in the second's axes
    and against them; T is 1 where neither body moves."""
    R, R1, A, w = first.at(now)
    S, S1, B, v = second.at(now)
    away, C = _turned(B, R - S), B.transpose(0, 2, 1) @ A
    z = away[:, None] + X @ C.transpose(0, 2, 1)
    own = np.cross(w[:, None], X[None]) @ C.transpose(0, 2, 1)
    rate = _turned(B, R1 - S1)[:, None] + own - np.cross(v[:, None], z)
    return z, np.asarray(rate)


def _turned(B: FloatArray, x: FloatArray) -> FloatArray:
    """(T, 3) of space vectors x in the axes B."""
    return np.asarray((x[:, None] @ B)[:, 0])
