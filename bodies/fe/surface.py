"""Boundary integrals of linear simplices, in closed form, facet by facet.

A facet is a row of d point numbers, ordered so that its normal points out of the body. Each
function takes any subset of facets, so a term that keeps a few rows evaluates a few facets.
"""

from math import factorial

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.mesh.simplices import boundary
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.mesh import Mesh


def boundary_facets(mesh: Mesh, nodes: IntArray) -> IntArray:
    """(F, d): the boundary facets whose points all belong to `nodes`, outward ordered.

    InputError when there are none: the set is inside the body, or a single point.
    """
    facets = boundary(mesh)
    facets = facets[np.isin(facets, nodes).all(axis=1)]
    if not len(facets):
        kind = "edge" if mesh.dimension == 2 else "face"
        raise InputError(
            f"none of the body's boundary {kind}s has all its points among the {len(nodes)} "
            f"points of this set: name a set that covers a piece of the surface"
        )
    return facets


def facet_normals(mesh: Mesh, facets: IntArray) -> FloatArray:
    """(F, d), m (2-D) or m2 (3-D): outward normals whose length is the facet's measure."""
    sides = mesh.points[facets[:, 1:]] - mesh.points[facets[:, :1]]
    if mesh.dimension == 2:
        return np.stack([sides[:, 0, 1], -sides[:, 0, 0]], axis=1)
    return np.asarray(np.cross(sides[:, 0], sides[:, 1]) / 2)


def facet_measures(mesh: Mesh, facets: IntArray) -> FloatArray:
    """(F,) length (m) or area (m2) of each facet."""
    return np.asarray(np.linalg.norm(facet_normals(mesh, facets), axis=1))


def facet_points(mesh: Mesh, facets: IntArray) -> IntArray:
    """Sorted numbers of the points that the facets touch."""
    return np.unique(facets)


def surface_load(mesh: Mesh, facets: IntArray, thickness: float = 1.0) -> FloatArray:
    """(N,), m2: integral of phi_i over the facets. Times a flux (W/m2) it is nodal heat (W)."""
    share = thickness * facet_measures(mesh, facets) / mesh.dimension
    return _to_points(mesh, facets, share)


def surface_normal_load(mesh: Mesh, facets: IntArray, thickness: float = 1.0) -> FloatArray:
    """(N, d), m2: integral of phi_i n, n outward. Times minus a pressure (Pa): nodal forces (N)."""
    shares = thickness * facet_normals(mesh, facets) / mesh.dimension
    return np.stack([_to_points(mesh, facets, share) for share in shares.T], axis=1)


def surface_mass(mesh: Mesh, facets: IntArray, weight: float) -> Csr:
    """(N, N): integral of weight phi_i phi_j over the facets.

    weight: film coefficient (W/(m2 K)) * thickness (m, 1 in 3-D) gives a convection matrix, W/K.
    """
    d, n = mesh.dimension, len(mesh.points)
    # over a simplex of dimension s: integral phi_i phi_j = measure s! (1 + delta_ij) / (s + 2)!
    local = (np.ones((d, d)) + np.eye(d)) * (factorial(d - 1) / factorial(d + 1))
    values = weight * facet_measures(mesh, facets)[:, None, None] * local
    rows = np.repeat(facets, d, axis=1).ravel()
    columns = np.tile(facets, d).ravel()
    matrix = csr_array((values.ravel(), (rows, columns)), shape=(n, n))
    matrix.sum_duplicates()
    return matrix


def _to_points(mesh: Mesh, facets: IntArray, share: FloatArray) -> FloatArray:
    weights = np.repeat(share, mesh.dimension)
    return np.bincount(facets.ravel(), weights, minlength=len(mesh.points)).astype(np.float64)
