"""Normals of boundary facets, independent of the quadrature of the product."""

import numpy as np

from sparsemor.core import FloatArray, IntArray, Mesh


def facet_normals(mesh: Mesh, facets: IntArray) -> FloatArray:
    """(F, d) integrals of the outward normal over the facets (F, w)."""
    a = mesh.points[facets]
    if mesh.dimension == 2:
        side = a[:, 1] - a[:, 0]
        return np.stack([side[:, 1], -side[:, 0]], axis=1)
    return np.asarray(np.cross(a[:, 2] - a[:, 0], a[:, -1] - a[:, 1]) / 2 if a.shape[1] == 4 else (
        np.cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0]) / 2))
