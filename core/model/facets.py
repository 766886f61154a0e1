"""Facets and boundary facets of meshes of triangles (2-D) or tetrahedra (3-D)."""

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.protocols.mesh import Mesh

FACETS = {
    2: ((0, 1), (1, 2), (2, 0)),
    3: ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
}
"""Local corner numbers of the facets of a positively oriented simplex, ordered for outward
normals."""
PARTS = {
    6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    10: ((0, 4, 6, 7), (4, 1, 5, 8), (6, 5, 2, 9), (7, 8, 9, 3),
         (4, 8, 5, 6), (4, 8, 6, 7), (9, 5, 8, 6), (9, 8, 7, 6)),
}
"""Local nodes of the linear simplices that a quadratic triangle (6 nodes) or tetrahedron (10) is
divided into."""


def subdivided(cells: IntArray) -> IntArray:
    """Linear simplices (E', d + 1) on the nodes of cells (E, p): 4 for each quadratic triangle, 8
    for each quadratic tetrahedron; linear cells as they are."""
    parts = PARTS.get(cells.shape[1])
    if parts is None:
        return cells
    divided: IntArray = cells[:, np.array(parts)].reshape(-1, len(parts[0]))
    return divided


def cell_facets(cells: IntArray) -> IntArray:
    """Point numbers (E * (d + 1), d) of the facets of all cells, cell by cell, ordered for outward
    normals."""
    d = cells.shape[1] - 1
    facets: IntArray = cells[:, np.array(FACETS[d])].reshape(-1, d)
    return facets


def facet_numbers(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Number of the geometric facet of each row of `cell_facets`, and how many cells share each
    facet."""
    number, _, count = group_equal_rows(np.sort(cell_facets(cells), axis=1))
    return number, count


def group_equal_rows(rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Groups of equal rows of an integer array (R, 2 to 4) with entries >= 0: for each row the
    number of its group, for each group its first row and its size; groups in lexicographic order.

    Equivalent to `np.unique(axis=0)` but much faster, because two columns are sorted as one
    integer.
    """
    size = int(rows.max(initial=0)) + 1
    head = rows[:, 0] * size + rows[:, 1]
    tail = rows[:, 2:] @ np.array([size, 1])[4 - rows.shape[1]:]
    order = np.lexsort((tail, head))
    head, tail = head[order], tail[order]
    new = np.ones(len(rows), dtype=np.bool_)
    new[1:] = (np.diff(head) != 0) | (np.diff(tail) != 0)
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    starts = np.flatnonzero(new)
    return number, order[starts], np.diff(starts, append=len(rows))


def outer_facets(mesh: Mesh) -> IntArray:
    """Point numbers (F, d) of the boundary facets, those of one cell only, ordered for outward
    normals."""
    number, count = facet_numbers(mesh.cells)
    return np.asarray(cell_facets(mesh.cells)[count[number] == 1])
