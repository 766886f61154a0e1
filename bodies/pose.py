"""Where a planar body is at the start, and how fast it moves."""

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.plugin import Plugin


class Pose(Plugin):
    """Frame origin and angle at the start, with their rates."""

    position: tuple[float, float] = (0.0, 0.0)
    """Position of the frame origin, m (space axes)."""
    angle: float = 0.0
    """Rotation of the frame, rad."""
    velocity: tuple[float, float] = (0.0, 0.0)
    """Velocity of the frame origin, m/s (space axes)."""
    spin: float = 0.0
    """Angular velocity, rad/s."""

    def coordinates(self) -> FloatArray:
        return np.array([*self.position, self.angle])

    def rates(self) -> FloatArray:
        return np.array([*self.velocity, self.spin])
