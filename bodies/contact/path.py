"""Rigid surfaces in the plane along a known motion."""

import numpy as np

from sparsemor.bodies.contact.part import Motion
from sparsemor.bodies.contact.surface import Surface
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import FloatArray


class Path:
    """A rigid surface along a motion; one row for all times where the body stands still."""

    def __init__(self, surface: Surface, motion: Motion) -> None:
        self.surface, history = surface, motion.get(surface.body.name)
        self.pose = surface.body.pose[None] if history is None else history.pose
        self.rate = np.zeros((1, 3)) if history is None else history.rate
        self.steps = len(self.pose)

    def _rows(self, values: FloatArray, now: slice) -> FloatArray:
        return values[now] if self.steps > 1 else values

    def origin(self, now: slice) -> ComplexArray:
        pose = self._rows(self.pose, now)
        return np.asarray(pose[:, :1] + 1j * pose[:, 1:2])

    def turned(self, now: slice) -> ComplexArray:
        """(T, 1) exp(i theta)."""
        return np.asarray(np.exp(1j * self._rows(self.pose, now)[:, 2:]))

    def points(self, now: slice) -> tuple[ComplexArray, ComplexArray]:
        """Positions and velocities (T, n)."""
        rate = self._rows(self.rate, now)
        r = self.turned(now) * self.surface.X
        v = rate[:, :1] + 1j * rate[:, 1:2] + 1j * rate[:, 2:] * r
        return self.origin(now) + r, v
