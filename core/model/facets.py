"""Facets of linear simplices, and which of them make the boundary; alike in 2-D and 3-D."""

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.protocols.mesh import Mesh

FACETS = {
    2: ((0, 1), (1, 2), (2, 0)),
    3: ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
}
"""Local corner numbers of a positive simplex's facets, ordered so that their normal is outward."""


def cell_facets(cells: IntArray) -> IntArray:
    """(E * (d + 1), d) point numbers of every cell's facets, cell by cell, outward ordered."""
    d = cells.shape[1] - 1
    facets: IntArray = cells[:, np.array(FACETS[d])].reshape(-1, d)
    return facets


def facet_numbers(cells: IntArray) -> tuple[IntArray, IntArray]:
    """For each row of `all_facets` the number of the geometric facet, and each facet's count."""
    number, _, count = group_equal_rows(np.sort(cell_facets(cells), axis=1))
    return number, count


def group_equal_rows(rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Groups of equal rows (R, 2 to 4) of numbers >= 0: for each row the number of its kind, for
    each kind its first row and its count; kinds in lexicographic order.

    As `np.unique(axis=0)`, but much faster: two columns fit in one integer to sort by.
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
    """(F, d) point numbers of the facets that one cell alone has, ordered for outward normals."""
    number, count = facet_numbers(mesh.cells)
    return np.asarray(cell_facets(mesh.cells)[count[number] == 1])
