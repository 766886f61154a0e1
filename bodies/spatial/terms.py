"""Inertia of a spatial body as one term: frame kernel, directions, generators."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, kron

from sparsemor.bodies.frame_term import FrameTerm
from sparsemor.bodies.spatial import nodal
from sparsemor.bodies.spatial.inertia import Inertia
from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.layout import Layout

if TYPE_CHECKING:
    from sparsemor.bodies.spatial.body import SpatialBody


def inertia_term(body: SpatialBody, layout: Layout, inertia: Inertia) -> FrameTerm:
    """Inertia of the rigid and elastic unknowns."""
    if body.elasticity is None or body.mass_matrix is None:
        return body.frame_term(layout, inertia, None)
    m = body.mass_matrix
    term = body.frame_term(layout, inertia, _directions(m, body.X, inertia), every=True)
    F = body.elasticity.free
    local = np.searchsorted(term.columns, body.position(layout, "elastic"))
    embed = csr_array((np.ones(len(F)), (np.arange(len(F)), local)),
                      shape=(len(F), len(term.columns)))
    Q = tuple(csr_array(embed.T @ generator(m, B)[F][:, F] @ embed) for B in inertia.moments.B)
    return replace(term, equations=replace(term.equations, Q=Q, V=Q))


def generator(m: Csr, B: FloatArray) -> Csr:
    """(3 N, 3 N): m (x) B without stored zeros."""
    return csr_array(kron(m, csr_array(B), format="csr"))


def _directions(m: Csr, X: FloatArray, inertia: Inertia) -> FloatArray:
    """(3 N, 3 + g): m e_i, then M_g X."""
    shape = [(m @ X @ B.T).ravel() for B in inertia.moments.B]
    first = nodal.along(np.asarray(m.sum(axis=1)).ravel())
    return np.concatenate([first, np.stack(shape, axis=1)], axis=1)
