"""A built planar body: its numbers, and what joints and loads may ask of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.body import Body
from sparsemor.bodies.body_terms import inertia_term
from sparsemor.bodies.frame_term import FrameEquations, FrameTerm
from sparsemor.bodies.planar.frame import PlanarFrame
from sparsemor.bodies.planar.items import Attachment, BodyForce, Item, SpaceForce
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import Term
from sparsemor.core.separable import Amplitude


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

    def frame_terms(self, layout: Layout) -> list[Term]:
        return [inertia_term(self, layout)] if self.moves or self.elasticity is not None else []

    # ------------------------------------------------------------------ for joints and loads

    def frame_term(
        self, layout: Layout, item: Item, vectors: Sequence[Any],
        multipliers: IntArray | None = None, C: FloatArray | None = None, every: bool = False,
    ) -> FrameTerm:
        """One item with its complex nodal vectors (N,), one a pair, as a Term.

        multipliers (l,) global numbers, C (l, forces): constraint rows are C @ attachment rows.
        every: keep all elastic unknowns as rows and columns, not only those the vectors touch.
        """
        elastic = self.elasticity is not None
        frame = PlanarFrame((item,), elastic)
        free = self.elasticity.free if self.elasticity is not None else np.zeros(0, np.int64)
        pairs = [np.stack([f, 1j * f], axis=1) for f in vectors] if elastic else []
        P = np.concatenate(pairs, axis=1) if pairs else np.zeros((len(self.X), 0), complex)
        P = np.stack([P.real, P.imag], axis=1).reshape(2 * len(self.X), P.shape[1])[free]
        used = np.arange(len(free)) if every else np.flatnonzero(np.any(P != 0, axis=1))
        rigid, el = self.position(layout, "rigid"), self.position(layout, "elastic")[used]
        lam = np.zeros(0, np.int64) if multipliers is None else multipliers
        C = np.zeros((0, item.forces)) if C is None else C
        at = np.concatenate([rigid, el, lam])
        r, e = len(rigid), len(used)
        Y, y0 = np.zeros((frame.border, len(at))), np.zeros(frame.border)
        Y[:r, :r] = np.eye(r)
        if not self.moves and self.guide is None:
            y0[:3] = self.pose
        Y[3:, r + e :] = C.T
        D, W = np.zeros((P.shape[1], len(at))), np.zeros((len(at), P.shape[1]))
        D[:, r : r + e], W[r : r + e] = P[used].T, P[used]
        return FrameTerm(self.name, at, at, FrameEquations(
            frame, Y, y0, D, (), Y.T.copy(), W, (), self.guide))

    def space_force(
        self, layout: Layout, weights: FloatArray, force: complex, amplitude: Amplitude,
        arm: complex | None = None,
    ) -> FrameTerm:
        """Nodal weights (N,) times one force (N per unit weight) in space axes."""
        arm = complex(weights @ self.X) if arm is None else arm
        item = SpaceForce(float(weights.sum()), arm, force, amplitude)
        return self.frame_term(layout, item, (weights.astype(complex),))

    def gravity(self, layout: Layout, g: complex, amplitude: Amplitude) -> FrameTerm:
        """Weight of the deformed body: nodal masses times g (m/s^2)."""
        item = SpaceForce(self.mass, self.moment, g, amplitude)
        m = self.mass_matrix
        weights = () if m is None else (np.asarray(m.sum(axis=1), dtype=complex),)
        return self.frame_term(layout, item, weights)

    def body_force(self, layout: Layout, forces: Any, amplitude: Amplitude) -> FrameTerm:
        """Complex nodal forces (N,) that turn with the body frame, N."""
        item = BodyForce(complex(forces.sum()), complex(np.vdot(forces, self.X)), amplitude)
        return self.frame_term(layout, item, (forces,))

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
