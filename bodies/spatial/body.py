"""A built spatial body: its numbers, and what joints and loads may ask of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.body import NO_NUMBERS, Body
from sparsemor.bodies.frame_term import FrameEquations, FrameTerm
from sparsemor.bodies.spatial import nodal
from sparsemor.bodies.spatial.attitude import attitude
from sparsemor.bodies.spatial.frame import SpatialFrame
from sparsemor.bodies.spatial.inertia import Inertia
from sparsemor.bodies.spatial.items import Attachment, BodyForce, Item, SpaceForce, UnitLength
from sparsemor.bodies.spatial.terms import inertia_term
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import Term
from sparsemor.core.separable import Amplitude


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
        """Whether its attitude is a quaternion, not an angle about z."""
        return len(self.pose) == 7

    @property
    def own_multipliers(self) -> int:
        """It keeps the quaternion's length."""
        return 1 if self.turns_freely else 0

    def frame_terms(self, layout: Layout) -> list[Term]:
        terms: list[Term] = []
        if self.inertia is not None and (self.moves or self.elasticity is not None):
            terms.append(inertia_term(self, layout, self.inertia))
        if self.moves and self.turns_freely:
            length = self.position(layout, "multiplier")
            terms.append(self.frame_term(layout, UnitLength(), None, length, np.eye(1)))
        return terms

    # ------------------------------------------------------------------ for joints and loads

    def frame_term(
        self, layout: Layout, item: Item, vectors: FloatArray | None,
        multipliers: IntArray = NO_NUMBERS, C: FloatArray | None = None,
        other: IntArray = NO_NUMBERS, every: bool = False,
    ) -> FrameTerm:
        """One item with its nodal directions (3 N, directions) as a Term.

        multipliers (l,) global numbers, C (l, forces): constraint rows are C @ the item's rows;
        other: rigid coordinates of the other body that the item reads. every: keep all elastic
        unknowns as rows and columns, not only those the vectors touch.
        """
        e = self.elasticity
        frame = SpatialFrame((item,), e is not None, len(self.pose))
        P = np.zeros((0, 0)) if e is None or vectors is None else vectors[e.free]
        used = np.arange(len(P)) if every else np.flatnonzero(np.any(P != 0, axis=1))
        rigid, el = self.position(layout, "rigid"), self.position(layout, "elastic")[used]
        at = np.sort(np.concatenate([rigid, other, el, multipliers]))
        own, read, mine, lam = (np.searchsorted(at, n) for n in (rigid, other, el, multipliers))
        Y, y0, d = np.zeros((frame.border, len(at))), np.zeros(frame.border), frame.rigid_size
        Y[np.arange(len(own)), own] = 1.0
        Y[len(self.pose) + np.arange(len(read)), read] = 1.0
        if not self.moves and self.guide is None:
            y0[: len(self.pose)] = self.pose
        if C is not None:
            Y[d:, lam] = C.T
        D, W = np.zeros((frame.p, len(at))), np.zeros((len(at), frame.p))
        if frame.p:
            D[:, mine], W[mine] = P[used].T, P[used]
        return FrameTerm(self.name, at, at, FrameEquations(
            frame, Y, y0, D, (), Y.T.copy(), W, (), self.guide))

    def space_force(
        self, layout: Layout, weights: FloatArray, force: FloatArray, amplitude: Amplitude
    ) -> FrameTerm:
        """Nodal weights (N,) times one force (3,) (N per unit weight) in space axes."""
        item = SpaceForce(float(weights.sum()), weights @ self.X, force, amplitude)
        return self.frame_term(layout, item, nodal.along(weights))

    def gravity(self, layout: Layout, g: FloatArray, amplitude: Amplitude) -> Sequence[FrameTerm]:
        """Weight of the deformed body: nodal masses times g (3,), m/s^2."""
        if self.inertia is None:
            return ()
        item = SpaceForce(self.inertia.mass, self.inertia.moment, g, amplitude)
        m = self.mass_matrix
        vectors = None if m is None else nodal.along(np.asarray(m.sum(axis=1)).ravel())
        return (self.frame_term(layout, item, vectors),)

    def body_force(self, layout: Layout, forces: FloatArray, amplitude: Amplitude) -> FrameTerm:
        """Nodal forces (N, 3) that turn with the body frame, N."""
        item = BodyForce(forces.sum(axis=0), np.cross(self.X, forces).sum(axis=0), amplitude)
        return self.frame_term(layout, item, nodal.with_torques(forces))

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
