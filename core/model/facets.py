"""Facets and boundary facets of meshes."""

import numpy as np

from sparsemor.core.arrays import BoolArray, IntArray
from sparsemor.core.protocols.cells import KINDS, by_kind, corners_of, padded
from sparsemor.core.protocols.mesh import Mesh

SIMPLICES = {
    (2, False): ((0, 1),), (3, False): ((0, 1, 2),), (4, False): ((0, 1, 2), (0, 2, 3)),
    (2, True): ((0, 2), (2, 1)), (3, True): ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    (4, True): tuple(t for i in range(4) for t in ((i, 4 + i, 8), (4 + i, (i + 1) % 4, 8)))}
"""Segments or triangles on the nodes of a line, a triangle or a quadrilateral by its corners, and
True for second order: corners, then the nodes of the edges between consecutive corners, then the
one inside."""


def plane_triangles(nodes: IntArray) -> IntArray:
    """Triangles (T, 3) on the nodes (E, q) of plane cells of first or second order."""
    return np.concatenate([own[:, np.array(SIMPLICES[p, own.shape[1] > p])].reshape(-1, 3)
                           for _, own in by_kind(nodes, 2)
                           for p in [corners_of(2, own.shape[1])]])


def linear_facets(nodes: IntArray, d: int) -> tuple[IntArray, IntArray]:
    """Segments or triangles (S, d) on the nodes (E, q) of the facets of cells of first or second
    order, ordered for outward normals, and the row of `cell_facets` of each."""
    rows, facet_of, start = [], [], 0
    for _, cells in by_kind(nodes, d):
        kind = KINDS[d, corners_of(d, cells.shape[1])]
        p, facet_count = len(kind.places), len(kind.facets)
        # kind.facets: corners of each facet; kind.further: corners between which each further node
        # lies. Local number of the node of an edge or quadrilateral, by its corners:
        number_of = {frozenset(c): p + i for i, c in enumerate(kind.further)}
        for k, f in enumerate(kind.facets):
            second = cells.shape[1] > p
            ends = [f] if d == 2 else zip(f, [*f[1:], f[0]], strict=True)
            local = [*f, *(number_of[frozenset(e)] for e in ends if second)]
            if second and len(f) == 4:
                local.append(number_of[frozenset(f)])
            # SIMPLICES: by positions in the list of the facet's nodes; now by nodes of the cell
            simplices = np.array(local)[np.array(SIMPLICES[len(f), second])]
            rows.append(cells[:, simplices].reshape(-1, d))
            facets = start + facet_count * np.arange(len(cells)) + k
            facet_of.append(np.repeat(facets, len(simplices)))
        start += facet_count * len(cells)
    order = np.argsort(np.concatenate(facet_of), kind="stable")
    return np.concatenate(rows)[order], np.concatenate(facet_of)[order]


def linear_surface(nodes: IntArray, d: int, own: IntArray | None = None) -> IntArray:
    """Segments or triangles (S, d) on the nodes (E, q) of the boundary facets of cells; own (E, q):
    other numbers of the same nodes, of which they are made instead."""
    corners = padded([row[:, : corners_of(d, row.shape[1])] for _, row in by_kind(nodes, d)],
                     [here for here, _ in by_kind(nodes, d)])
    number, count = facet_numbers(cell_facets(corners, d)[0])
    rows, of = linear_facets(nodes if own is None else own, d)
    return np.asarray(rows[count[number[of]] == 1])


def cell_facets(cells: IntArray, d: int) -> tuple[IntArray, IntArray]:
    """Corner numbers (R, w) of the facets of all cells (E, p), kind by kind and cell by cell,
    ordered for outward normals, and the cell (R,) of each. w: d, or 4 where some have 4 corners;
    those of three repeat the last."""
    rows, owners = [], []
    for here, own in by_kind(cells, d):
        facets = KINDS[d, own.shape[1]].facets
        # three corners next to four: the last is repeated
        wide = np.array([(*f, *f[-1:] * (max(map(len, facets)) - len(f))) for f in facets])
        rows.append(own[:, wide].reshape(-1, wide.shape[1]))
        owners.append(np.repeat(here, len(facets)))
    ends = np.cumsum([0, *map(len, rows)])
    return padded(rows, [np.arange(a, b) for a, b in zip(ends, ends[1:], strict=False)]), (
        np.concatenate(owners))


def facet_keys(facets: IntArray) -> IntArray:
    """Facets (R, w) with sorted corners, three followed by the largest again: equal for equal ones.
    """
    rows = np.sort(facets, axis=1)
    if rows.shape[1] == 4:
        new = np.ones(rows.shape, np.bool_)
        new[:, 1:] = rows[:, 1:] != rows[:, :-1]
        triangles = ~new.all(axis=1)
        rows[triangles, :3] = rows[triangles][new[triangles]].reshape(-1, 3)
    return rows


def facet_numbers(facets: IntArray) -> tuple[IntArray, IntArray]:
    """Number of the geometric facet of each row of `cell_facets`, and how many cells share each
    facet."""
    number, _, count = group_equal_rows(facet_keys(facets))
    return number, count


def rows_among(rows: IntArray, others: IntArray) -> BoolArray:
    """(R,) True for the facets of an array (R, w) that are among others, in any order."""
    wide = max(rows.shape[1], others.shape[1])
    both = [np.pad(r, ((0, 0), (0, wide - r.shape[1])), mode="edge") for r in (others, rows)]
    number, _, _ = group_equal_rows(facet_keys(np.concatenate(both)))
    return np.isin(number[len(others):], number[:len(others)])


def group_equal_rows(rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Groups of equal rows of an integer array (R, w) with entries >= 0: for each row the number of
    its group, for each group its first row and its size; groups in lexicographic order.

    Equivalent to `np.unique(axis=0)` but much faster, because two columns are sorted as one
    integer.
    """
    size = int(rows.max(initial=0)) + 1
    keys = [rows[:, i] * size + rows[:, i + 1] if i + 1 < rows.shape[1] else rows[:, i]
            for i in range(0, rows.shape[1], 2)]
    order = np.lexsort(keys[::-1])
    new = np.ones(len(rows), dtype=np.bool_)
    new[1:] = np.any([np.diff(key[order]) != 0 for key in keys], axis=0)
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    starts = np.flatnonzero(new)
    return number, order[starts], np.diff(starts, append=len(rows))


def outer_facets(mesh: Mesh) -> IntArray:
    """Corner numbers (F, w) of the boundary facets, those of one cell only, ordered for outward
    normals."""
    facets, _ = cell_facets(mesh.cells, mesh.dimension)
    number, count = facet_numbers(facets)
    return np.asarray(facets[count[number] == 1])
