"""Contributions of inertia: a frame item, its directions and generators."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, kron

from sparsemor.bodies.frames import nodal
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.plane_items import Inertia as PlanarInertia
from sparsemor.core import Csr, Equations, FloatArray

if TYPE_CHECKING:
    from sparsemor.bodies.planar_body import PlanarBody
    from sparsemor.bodies.spatial_body import SpatialBody

J2 = np.array([[0.0, -1.0], [1.0, 0.0]])


def write_planar_inertia(body: PlanarBody, equations: Equations) -> None:
    """Inertia of the rigid and elastic unknowns, generators M and M J."""
    item = PlanarInertia(body.mass, body.moment, body.inertia)
    if body.elasticity is None or body.mass_matrix is None:
        body.frame_item(equations, item, ())
        return
    m, F = body.mass_matrix, body.elasticity.free
    vectors = (np.asarray(m.sum(axis=1), dtype=complex), m @ body.X)
    body.frame_item(equations, item, vectors, generators=[
        csr_array(kron(m, B, format="csr")[F][:, F]) for B in (np.eye(2), J2)])


def write_spatial_inertia(body: SpatialBody, equations: Equations, inertia: Inertia) -> None:
    """Inertia of the rigid and elastic unknowns."""
    if body.elasticity is None or body.mass_matrix is None:
        body.frame_item(equations, inertia, None)
        return
    m, F = body.mass_matrix, body.elasticity.free
    body.frame_item(equations, inertia, _directions(m, body.X, inertia), generators=[
        csr_array(generator(m, B)[F][:, F]) for B in inertia.moments.B])


def generator(m: Csr, B: FloatArray) -> Csr:
    """(3 N, 3 N): m (x) B without stored zeros."""
    return csr_array(kron(m, csr_array(B), format="csr"))


def _directions(m: Csr, X: FloatArray, inertia: Inertia) -> FloatArray:
    """(3 N, 3 + g): m e_i, then M_g X."""
    shape = [(m @ X @ B.T).ravel() for B in inertia.moments.B]
    first = nodal.along(np.asarray(m.sum(axis=1)).ravel())
    return np.concatenate([first, np.stack(shape, axis=1)], axis=1)
