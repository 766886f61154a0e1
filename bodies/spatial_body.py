"""A built spatial body: its numbers, and what joints and loads may ask of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.body import Body
from sparsemor.bodies.frames import nodal
from sparsemor.bodies.frames.attitude import attitude
from sparsemor.bodies.frames.frame import SpatialFrame
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.items import Attachment, BodyForce, Item, SpaceForce, UnitLength
from sparsemor.bodies.terms.inertia import write_spatial_inertia
from sparsemor.core import Csr, Equations, FloatArray
from sparsemor.core.protocols.separable import Amplitude


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SpatialBody(Body):
    """One body in space (see `Body`); rigid coordinates are position (3) and unit quaternion (4),
    or position and angle (1) for a frame that turns about the z axis alone.

    X (N, 3); inertia: mass and moments about the frame origin, or None for a frame without mass.
    """

    X: FloatArray
    inertia: Inertia | None

    @property
    def coordinates(self) -> FloatArray:
        return self.X

    @property
    def turns_freely(self) -> bool:
        """True if its attitude is a quaternion, not an angle about z."""
        return len(self.pose) == 7

    @property
    def own_multipliers(self) -> int:
        """It keeps the quaternion's length."""
        return 1 if self.turns_freely else 0

    def frame_of(self, items: Sequence[Any]) -> SpatialFrame:
        return SpatialFrame(tuple(items), self.elasticity is not None, len(self.pose))

    def frame_equations(self, equations: Equations) -> None:
        if self.inertia is not None and (self.moves or self.elasticity is not None):
            write_spatial_inertia(self, equations, self.inertia)
        if self.moves and self.turns_freely:
            self.frame_item(equations, UnitLength(), None,
                            multipliers=f"{self.name}.multiplier", C=np.eye(1))

    # ------------------------------------------------------------------ for joints and loads

    def frame_item(
        self, equations: Equations, item: Item, vectors: FloatArray | None, *,
        multipliers: str = "", C: FloatArray | None = None, reads: str = "",
        generators: Sequence[Csr] = (),
    ) -> None:
        """Contributes one item with its nodal directions (3 N, directions).

        multipliers, C (l, forces): constraint rows of that block are C @ the item's rows; reads:
        rigid block of the other body that the item reads.
        """
        e = self.elasticity
        equations.frame(
            self.name, item, None if e is None or vectors is None else vectors[e.free],
            multipliers=multipliers, C=C, reads=reads, generators=generators)

    def space_force(
        self, equations: Equations, weights: FloatArray, force: FloatArray, amplitude: Amplitude
    ) -> None:
        """Nodal weights (N,) times one force (3,) (N per unit weight) in space axes."""
        item = SpaceForce(float(weights.sum()), weights @ self.X, force, amplitude)
        self.frame_item(equations, item, nodal.along(weights))

    def gravity(self, equations: Equations, g: FloatArray, amplitude: Amplitude) -> None:
        """Weight of the deformed body: nodal masses times g (3,), m/s^2."""
        if self.inertia is None:
            return
        item = SpaceForce(self.inertia.mass, self.inertia.moment, g, amplitude)
        m = self.mass_matrix
        vectors = None if m is None else nodal.along(np.asarray(m.sum(axis=1)).ravel())
        self.frame_item(equations, item, vectors)

    def body_force(self, equations: Equations, forces: FloatArray, amplitude: Amplitude) -> None:
        """Nodal forces (N, 3) that turn with the body frame, N."""
        item = BodyForce(forces.sum(axis=0), np.cross(self.X, forces).sum(axis=0), amplitude)
        self.frame_item(equations, item, nodal.with_torques(forces))

    def attachment(self, weights: FloatArray) -> tuple[Attachment, FloatArray]:
        """The mean point of the weighted nodes, with its nodal directions (3 N, 3)."""
        return Attachment(weights @ self.X), nodal.along(weights)

    # ------------------------------------------------------------------ where points are

    def start_rotation(self) -> FloatArray:
        """(3, 3): body axes to space axes at the start."""
        return attitude(self.pose[3:]).A

    def start_position(self, weights: FloatArray) -> FloatArray:
        """(3,) global position of the weighted mean point at the start, m."""
        return np.asarray(self.pose[:3] + self.start_rotation() @ (weights @ self.X))
