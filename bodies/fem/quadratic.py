"""Quadratic triangles and tetrahedra: linear ones with a node in the middle of each edge."""

from dataclasses import replace

import numpy as np

from sparsemor.core import BoolArray, IntArray, Mesh
from sparsemor.core.model.facets import outer_facets


def with_midpoints(mesh: Mesh) -> Mesh:
    """Mesh of quadratic elements with the corners and named sets of a mesh of linear ones.

    The midpoint of an edge belongs to a set if both ends do, and the edge is part of a boundary
    facet or a cell that is in the set as a whole. An edge that crosses the body from one piece of
    the set to another has its midpoint outside. The midpoints of a set that consists of facets or
    cells tagged by the mesh are those of their edges.
    """
    from sparsemor.bodies.fem import forms

    ends, of = forms.edges(mesh)
    n = len(mesh.points)
    middles = mesh.points[ends].mean(axis=1)
    d = mesh.dimension
    corners = [(i, j) for i in range(d) for j in range(i)]

    def among(facets: IntArray) -> BoolArray:
        keys, sides = (np.sort(pairs, axis=1) @ np.array([n, 1])
                       for pairs in (ends, facets[:, corners].reshape(-1, 2)))
        return np.isin(keys, sides)

    outer = among(outer_facets(mesh))

    def extended(name: str, members: IntArray) -> IntArray:
        facets, cells = mesh.facet_sets.get(name), mesh.cell_sets.get(name)
        if facets is not None and len(np.unique(facets)) == len(members):
            return np.concatenate([members, n + np.flatnonzero(among(facets))])
        if cells is not None and len(np.unique(mesh.cells[cells])) == len(members):
            return np.concatenate([members, n + np.unique(of[cells])])
        return _extended(mesh, members, ends, of, outer)

    return replace(
        mesh, points=np.concatenate([mesh.points, middles]), midpoints=n + of,
        point_sets={name: extended(name, members) for name, members in mesh.point_sets.items()})


def _extended(
    mesh: Mesh, members: IntArray, ends: IntArray, of: IntArray, outer: BoolArray
) -> IntArray:
    """Sorted members of a set with the midpoints of its edges. ends (M, 2), of (E, 3 or 6): edges
    and those of each cell; outer (M,): True for edges of boundary facets."""
    inside = np.zeros(len(mesh.points), dtype=np.bool_)
    inside[members] = True
    both = inside[ends].all(axis=1)
    filled = np.zeros(len(ends), dtype=np.bool_)
    filled[of[inside[mesh.cells].all(axis=1)]] = True
    return np.concatenate([members, len(mesh.points) + np.flatnonzero(both & (outer | filled))])
