"""Quadratic triangles and tetrahedra: linear ones with a node in the middle of each edge."""

from dataclasses import replace

import numpy as np

from sparsemor.core import BoolArray, IntArray, Mesh, outer_facets


def with_midpoints(mesh: Mesh) -> Mesh:
    """Mesh of quadratic elements with the corners and named sets of a mesh of linear ones.

    The midpoint of an edge belongs to a set if both ends do, and the edge is part of a boundary
    facet or a cell that is in the set as a whole. An edge that crosses the body from one piece of
    the set to another has its midpoint outside.
    """
    from sparsemor.bodies.fem import forms

    ends, of = forms.edges(mesh)
    n = len(mesh.points)
    middles = mesh.points[ends].mean(axis=1)
    facets = outer_facets(mesh)
    d = mesh.dimension
    sides = facets[:, [(i, j) for i in range(d) for j in range(i)]].reshape(-1, 2)
    keys, outer = (np.sort(pairs, axis=1) @ np.array([n, 1]) for pairs in (ends, sides))
    return replace(
        mesh, points=np.concatenate([mesh.points, middles]), midpoints=n + of,
        point_sets={name: _extended(mesh, members, ends, of, np.isin(keys, outer))
                    for name, members in mesh.point_sets.items()})


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
