"""Surfaces whose border cuts facets: their measure compared with that of the facets in the set."""

import numpy as np

from sparsemor.bodies.mesh.sets import PointSet
from sparsemor.bodies.mesh.simplices import triangulated
from sparsemor.core import FloatArray, InputError, IntArray, Mesh
from sparsemor.core.model.facets import outer_facets

SAMPLES = {2: 64, 3: 8}
"""Parts of an edge (in space: of each side of a triangle) at whose centres a condition is
evaluated."""
SAME_SIDE = 0.7
"""Smallest cosine of the angle between facets that belong to the same side of a body."""


def cut_measures(mesh: Mesh, declared: PointSet, facets: IntArray) -> tuple[float, float]:
    """Length (m) or area (m2) of the facets (F, d) of a set, and of the patch of the surface that
    its `box` or `where` describes there.

    Facets next to them on the same side of the body, with some corners in the set and some not, are
    the cut ones: the share of each that is in the patch is found by sampling.
    """
    outer, facets = triangulated(outer_facets(mesh)), triangulated(facets)
    inside = np.isin(outer, facets)
    ours = _measures(mesh, facets)
    total = float(np.linalg.norm(ours, axis=1).sum())
    mixed = outer[inside.any(axis=1) & ~inside.all(axis=1)]
    if not len(mixed) or (declared.box is None and declared.where is None):
        return total, total
    # unit normals of the facets of the set, gathered at their corners
    sums = np.zeros_like(mesh.points)
    np.add.at(sums, facets, ours[:, None])
    normals = _measures(mesh, mixed)
    size = np.linalg.norm(normals, axis=1)
    near = sums[mixed]
    length = np.linalg.norm(near, axis=2)
    cosine = np.einsum("fkd,fd->fk", near, normals) / np.maximum(length * size[:, None], 1e-300)
    mixed, size = (a[(cosine > SAME_SIDE).any(axis=1)] for a in (mixed, size))
    if not len(mixed):
        return total, total
    weights = _weights(mesh.dimension)
    at = np.einsum("sk,fkd->fsd", weights, mesh.points[mixed])
    try:
        found = declared.contains(at.reshape(-1, mesh.dimension), mesh).reshape(len(mixed), -1)
    except InputError:  # the condition is defined at nodes only
        return total, total
    return total, total + float(size @ found.mean(axis=1))


def _measures(mesh: Mesh, facets: IntArray) -> FloatArray:
    """(F, d) outward normals whose length is the facet's measure."""
    sides = mesh.points[facets[:, 1:]] - mesh.points[facets[:, :1]]
    if mesh.dimension == 2:
        return np.stack([sides[:, 0, 1], -sides[:, 0, 0]], axis=1)
    return np.asarray(np.cross(sides[:, 0], sides[:, 1]) / 2)


def _weights(d: int) -> FloatArray:
    """(S, d) barycentric coordinates of the centres of equal parts of a facet."""
    n = SAMPLES[d]
    if d == 2:
        x = (np.arange(n) + 0.5) / n
        return np.stack([1 - x, x], axis=1)
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(n) for j in range(n - i)]
    turned = [(i + 2 / 3, j + 2 / 3) for i in range(n) for j in range(n - i - 1)]
    xy = np.array(upright + turned) / n
    return np.column_stack([1 - xy.sum(axis=1), xy])
