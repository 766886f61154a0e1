"""A built planar body: its numbers, and what joints and loads may ask of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.body import Body
from sparsemor.bodies.frames.plane import PlanarFrame
from sparsemor.bodies.frames.plane_items import Attachment, BodyForce, Item, SpaceForce
from sparsemor.bodies.terms.inertia import write_planar_inertia
from sparsemor.core import Csr, Equations, FloatArray
from sparsemor.core.protocols.separable import Amplitude


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanarBody(Body):
    """One body in the plane (see `Body`).

    X (N,) complex; pose (R_x, R_y, theta). mass, kg; moment = sum m X, kg m; inertia about the
    frame origin, kg m^2.
    """

    mass: float
    moment: complex
    inertia: float

    @property
    def coordinates(self) -> FloatArray:
        return np.stack([self.X.real, self.X.imag], axis=1)

    def frame_of(self, items: Sequence[Any]) -> PlanarFrame:
        return PlanarFrame(tuple(items), self.elasticity is not None)

    def frame_equations(self, equations: Equations) -> None:
        if self.moves or self.elasticity is not None:
            write_planar_inertia(self, equations)

    # ------------------------------------------------------------------ for joints and loads

    def frame_item(
        self, equations: Equations, item: Item, vectors: Sequence[Any], *,
        multipliers: str = "", C: FloatArray | None = None, generators: Sequence[Csr] = (),
    ) -> None:
        """Contributes one item with its complex nodal vectors (N,), one a pair.

        multipliers, C (l, forces): constraint rows of that block are C @ attachment rows.
        """
        directions: FloatArray | None = None
        if self.elasticity is not None and vectors:
            P = np.concatenate([np.stack([f, 1j * f], axis=1) for f in vectors], axis=1)
            both = np.stack([P.real, P.imag], axis=1).reshape(2 * len(self.X), P.shape[1])
            directions = both[self.elasticity.free]
        equations.frame(self.name, item, directions, multipliers=multipliers, C=C,
                        generators=generators)

    def space_force(
        self, equations: Equations, weights: FloatArray, force: complex, amplitude: Amplitude
    ) -> None:
        """Nodal weights (N,) times one force (N per unit weight) in space axes."""
        item = SpaceForce(float(weights.sum()), complex(weights @ self.X), force, amplitude)
        self.frame_item(equations, item, (weights.astype(complex),))

    def gravity(self, equations: Equations, g: complex, amplitude: Amplitude) -> None:
        """Weight of the deformed body: nodal masses times g (m/s^2)."""
        item = SpaceForce(self.mass, self.moment, g, amplitude)
        m = self.mass_matrix
        weights = () if m is None else (np.asarray(m.sum(axis=1), dtype=complex),)
        self.frame_item(equations, item, weights)

    def body_force(self, equations: Equations, forces: Any, amplitude: Amplitude) -> None:
        """Complex nodal forces (N,) that turn with the body frame, N."""
        item = BodyForce(complex(forces.sum()), complex(np.vdot(forces, self.X)), amplitude)
        self.frame_item(equations, item, (forces,))

    def attachment(self, weights: FloatArray, turns: bool) -> tuple[Attachment, tuple[Any, ...]]:
        """The mean point of the weighted nodes, with its complex direction vectors."""
        point = complex(weights @ self.X)
        vectors: tuple[Any, ...] = (weights.astype(complex),)
        if turns:
            arm = self.X - point
            size = float(weights @ np.abs(arm) ** 2)
            # least-squares rotation of the set: sum w (i arm) . u / sum w |arm|^2
            vectors += (weights * 1j * arm / size if size > 0 else np.zeros_like(self.X),)
        return Attachment(point, turns), vectors

    # ------------------------------------------------------------------ where points are

    def start_position(self, weights: FloatArray) -> complex:
        """Global position of the weighted mean point at the start, m."""
        turn = np.exp(1j * self.pose[2])
        return complex(self.pose[0] + 1j * self.pose[1] + turn * (weights @ self.X))
