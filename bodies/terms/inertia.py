"""Contributions of inertia: a frame item, its directions and generators."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, kron

from sparsemor.bodies.frames import nodal
from sparsemor.bodies.frames.inertia import Inertia
from sparsemor.bodies.frames.moments import moments_of
from sparsemor.core import Csr, Equations, FloatArray

if TYPE_CHECKING:
    from sparsemor.bodies.body import Body


def write_inertia(body: Body, equations: Equations) -> None:
    """Inertia of the rigid and elastic unknowns; none of a frame without mass."""
    if body.inertia is None:
        return
    moments = moments_of(len(body.pose))
    item = Inertia.of(body.inertia, moments)
    if body.elasticity is None or body.mass_matrix is None:
        body.frame_item(equations, item, None)
        return
    m, F = body.mass_matrix, body.elasticity.free
    body.frame_item(equations, item, _directions(m, body.X, moments.B), generators=[
        generator(m, B)[F][:, F] for B in moments.B])


def generator(m: Csr, B: FloatArray) -> Csr:
    """(d N, d N): m (x) B without stored zeros."""
    return csr_array(kron(m, csr_array(B), format="csr"))


def _directions(m: Csr, X: FloatArray, matrices: FloatArray) -> FloatArray:
    """(d N, d + g): m e_i, then M_g X of the g matrices (g, d, d)."""
    shape = [(m @ X @ B.T).ravel() for B in matrices]
    first = nodal.along(np.asarray(m.sum(axis=1)).ravel(), X.shape[1])
    return np.concatenate([first, np.stack(shape, axis=1)], axis=1)
