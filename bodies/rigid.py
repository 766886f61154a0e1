"""A rigid body: six numbers in the plane, whatever its shape."""

from pathlib import Path

import numpy as np
from pydantic import Field

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.pose import Pose
from sparsemor.core.plugin import Plugin


class Rigid(Plugin):
    """Newton-Euler equations about the frame origin (equations.md, section 1, without u)."""

    mass: float = Field(gt=0)
    """Mass, kg."""
    inertia: float = Field(ge=0)
    """Moment of inertia about the centre of mass, kg m^2."""
    center: tuple[float, float] = (0.0, 0.0)
    """Centre of mass in the body frame, m."""
    points: dict[str, tuple[float, float]] = {}
    """Named points for joints, loads and probes: body-frame coordinates, m."""
    pose: Pose = Pose()
    """Frame origin, angle and their rates at the start."""

    def build(self, name: str, base: Path) -> PlanarBody:
        X = np.array([complex(*p) for p in self.points.values()], dtype=complex)
        com = complex(*self.center)
        return PlanarBody(
            name=name, X=X, mass=self.mass, moment=self.mass * com,
            inertia=self.inertia + self.mass * abs(com) ** 2,
            pose=self.pose.coordinates(), velocity=self.pose.rates(), moves=True,
            points={p: np.array([i]) for i, p in enumerate(self.points)},
        )
