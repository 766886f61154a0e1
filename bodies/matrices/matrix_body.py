"""Built body from matrices: unknowns of nodes and modes instead of a mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.frames.applied_forces import BodyForce
from sparsemor.bodies.frames.floating import FieldInertia, inertia_matrices
from sparsemor.bodies.frames.mass_moments import MassProperties
from sparsemor.bodies.frames.mean_displacement_and_rotation import mean_displacement, with_torques
from sparsemor.bodies.frames.rotation import torque
from sparsemor.bodies.matrices.displacement_unknowns import Unknowns
from sparsemor.bodies.mesh.set_centres import Centre
from sparsemor.core import Amplitude, Csr, Equations, FloatArray, InputError, IntArray

ROUND_OFF = 1e-6
"""Largest relative deviation of matrices from what a free body has: files have few digits."""


@dataclass(frozen=True, slots=True, eq=False)
class NodalLoads:
    """Loads on nodes: forces (N, d), N, moments (N, r), N m, in axes of the body, heat (N,), W."""

    forces: FloatArray
    moments: FloatArray
    heat: FloatArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MatrixBody(FloatingBody):
    """One body whose matrices are given.

    mass (n, n): of all unknowns of the nodes; shapes (n, k): values of these for each of k
    generalized coordinates, which then are its displacement unknowns; None: they are the unknowns
    of the nodes. coordinates (k,): unknowns of the nodes that these coordinates are, None if they
    are none. weights: set -> weights of its nodes, in their order, where they are given.
    load_vectors: nodal loads by name.
    """

    unknowns: Unknowns
    mass: Csr | None = None
    shapes: FloatArray | None = None
    coordinates: IntArray | None = None
    weights: Mapping[str, FloatArray] = field(default_factory=dict)
    load_vectors: Mapping[str, NodalLoads] = field(default_factory=dict)

    def _own(self, vectors: FloatArray) -> FloatArray:
        """(k, p) products of functionals (n, p) of the unknowns of the nodes with its own."""
        assert self.elasticity is not None
        return np.asarray(vectors[self.elasticity.free] if self.shapes is None else (
            self.shapes.T @ vectors))

    def _functionals(self, vectors: FloatArray) -> FloatArray | None:
        """(k, p) functionals of its elastic unknowns from those of nodal displacements, (d N, p);
        None without an elastic field."""
        return None if self.elasticity is None else self._own(
            self.unknowns.displacements @ vectors)

    def _field_inertia(self) -> FieldInertia | None:
        """Inertia of the free unknowns, or of generalized coordinates T (shapes): M_g = (M B_g +
        B_g M) / 2, which is m (x) B_g for the mass matrix m (x) I of solids, M times translations
        (`_first`) and M times the fields B_g x. B_g: constant matrices of the frame. `_own`: rows
        of the free unknowns, or T^T times vectors. None without an elastic field or mass."""
        e, M, u, T = self.elasticity, self.mass, self.unknowns, self.shapes
        if e is None or M is None or self.inertia is None:
            return None
        B = inertia_matrices(self.pose)
        matrices = []
        for b in B:
            by_node = u.matrix(b)
            found = (0.5 * (M @ by_node + by_node @ M)).tocsr()
            matrices.append(found[e.free][:, e.free] if T is None else csr_array(T.T @ (found @ T)))
        first = self._first()
        assert first is not None
        return FieldInertia(
            first, self._own(np.stack([M @ u.field(b) for b in B], axis=1)), matrices)

    def _first(self) -> FloatArray | None:
        return None if self.elasticity is None or self.mass is None else self._own(
            self.mass @ self.unknowns.rigid_modes[:, : self.d])

    def load_vector(
        self, equations: Equations, loads: NodalLoads, amplitude: Amplitude
    ) -> None:
        """Adds nodal loads times an amplitude: heat, and forces and moments that turn with the
        body, as resultants on its frame (force, torque about the frame origin) and vectors on its
        elastic unknowns: the load, then sum u x f of the forces."""
        if loads.heat.any():
            self.heat_load(equations, loads.heat, amplitude)
        if self.immobile or not (loads.forces.any() or loads.moments.any()):
            return
        item = BodyForce(loads.forces.sum(axis=0), torque(self.X, loads.forces).sum(axis=0)
                         + loads.moments.sum(axis=0), amplitude)
        vectors = self.unknowns.displacements @ with_torques(loads.forces)
        vectors[:, 0] += self.unknowns.rotations @ loads.moments.ravel()
        equations.frame(self.name, item, None if self.elasticity is None else self._own(vectors))

    def _places(self, free: IntArray) -> tuple[FloatArray, IntArray]:
        u = self.unknowns
        if self.coordinates is not None:
            return u.places(self.coordinates[free])
        return (u if self.shapes is None else Unknowns.modal_of(u.X, len(free))).places(free)

    def deforms_at(self, which: str) -> bool:
        if self.elasticity is None:
            return False
        here = np.isin(self.unknowns.node, self.points[which]).astype(np.float64)
        return bool((self.unknowns.node[self.elasticity.free][:, None] == self.points[which]).any()
                    if self.shapes is None else (here @ np.abs(self.shapes)).any())

    def rotation_of(self, which: str, key: str) -> FloatArray | None:
        """Mean rotation of the set as functionals (k, r) of the elastic unknowns: of its nodes
        where all have their r rotations, else by least squares of displacements; None where the set
        does not turn. even (N,): weights of the mean over the set; key: option of an InputError;
        u.component: 0 to d - 1 of displacements, d and more of rotations."""
        u, r = self.unknowns, 2 * self.d - 3
        if self.elasticity is None:
            return None
        weights = self.centre_of(which, self.points[which]).even
        turning = np.bincount(u.node[u.component >= self.d], minlength=len(self.X))
        if (turning[self.points[which]] < r).any():
            return FloatingBody.rotation_of(self, which, key)
        found = self._own(u.rotations @ mean_displacement(weights, r))
        return found if found.any() else None

    def centre_of(self, which: str, nodes: IntArray) -> Centre:
        if which not in self._centres:
            self._centres[which] = Centre.of_points(
                self.X, nodes, self.weights.get(which), self.centres.get(which))
        return self._centres[which]

    def _probed(self, at: str | Sequence[float]) -> tuple[FloatArray, FloatArray]:
        if isinstance(at, str) or len(at) != self.d:
            return FloatingBody._probed(self, at)
        weights = np.zeros(len(self.X))
        weights[np.argmin(np.linalg.norm(self.X - np.array(at), axis=1))] = 1.0
        return weights, weights @ self.X


def mass_properties(M: Csr, u: Unknowns, written: str, free: bool) -> MassProperties:
    """Mass, first moment sum m X and second moment sum m X X^T from the products of M (n, n) with
    the rigid-body modes: translations with rotations give the first moment, rotations with each
    other the tensor J (in the plane a number, which determines the trace of the second moment
    alone). free: M is that of a body without supports; written: its file, for errors.

    InputError where they are those of no body: the mass differs between directions, or moments of
    inertia are impossible, as when rows of M are missing.
    """
    d, modes = u.d, u.rigid_modes
    G = modes.T @ (M @ modes)  # rigid mass matrix: translations, then rotations about the origin
    size = float(np.abs(G[:d, :d]).max(initial=0.0))
    mass = float(np.trace(G[:d, :d]) / d)
    if not mass > 0.0 or free and np.abs(G[:d, :d] - mass * np.eye(d)).max() > ROUND_OFF * size:
        along = ", ".join(f"{m:.6g}" for m in np.diag(G)[:d])
        raise InputError(f"'{written}': the mass of a translation along {'xyz'[:d]} is {along} kg, "
                         "and that of a body is positive and the same in all directions: take the "
                         "mass matrix of all unknowns, before supports are eliminated", "mass")
    if d == 2:
        moment, J = np.array([G[1, 2], -G[0, 2]]), float(G[2, 2])
        return MassProperties(mass, moment, 0.5 * J * np.eye(2))
    S, J3 = G[:3, 3:], G[3:, 3:]
    moment = 0.5 * np.array([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
    arm = float(np.sqrt(max(np.trace(J3), 0.0) * mass))
    second = 0.5 * np.trace(J3) * np.eye(3) - J3
    least = float(np.linalg.eigvalsh(second - np.outer(moment, moment) / mass)[0])
    if free and (np.abs(S + S.T).max() > ROUND_OFF * arm or least < -ROUND_OFF * np.trace(J3)):
        raise InputError(f"'{written}': no body has its moments of inertia (J = "
                         f"{np.array2string(np.diag(J3), precision=4)} kg m2 about the origin): "
                         "do its unknowns belong to these nodes, in this order?", "mass")
    return MassProperties(mass, moment, second)


def motion_error(matrix: Csr, modes: FloatArray) -> float:
    """Largest |A v| / |A| |v| of rigid-body modes v (n, k), zero for a matrix that resists only
    deformation."""
    if not matrix.nnz:
        return 0.0
    found = np.abs(matrix @ modes).max(axis=0, initial=0.0)
    size = (abs(matrix) @ np.abs(modes)).max(axis=0, initial=0.0)
    return float(np.max(np.where(size > 0.0, found / np.where(size > 0.0, size, 1.0), 0.0)))
