"""Cells of second order: corners, and further nodes on edges, facets and inside.

The nodes inside a facet or cell follow from those of its edges by the serendipity functions: with
the corners x_i and the nodes m_j of its edges they are at (2 sum m_j - sum x_i) / 4 of a
quadrilateral and (sum m_j - sum x_i) / 4 of a hexahedron.
"""

from dataclasses import replace

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray, Mesh, information
from sparsemor.core.model.facets import cell_facets, facet_numbers, group_equal_rows, rows_among
from sparsemor.core.protocols.cells import KINDS, CellKind, by_kind, padded


def with_midpoints(
    mesh: Mesh, edges: IntArray | None = None, places: FloatArray | None = None
) -> Mesh:
    """Mesh of second order with the corners and named sets of one of first order.

    edges (m, 2), places (m, d): corners of edges, each once, and their nodes, m; other edges are
    straight. A further node belongs to a set if all corners between which it lies do, and they are
    part of a boundary facet or a cell that is in the set as a whole: an edge that crosses the body
    from one piece of the set to another has its node outside. Those of a set that consists of
    facets or cells tagged by the mesh are theirs. Further nodes follow the corners in `points`;
    kind.further: corners between which each further node of a cell lies.
    """
    d, n = mesh.dimension, len(mesh.points)
    kinds = [(here, own, KINDS[d, own.shape[1]]) for here, own in by_kind(mesh.cells, d)]
    further, nodes = [np.zeros((len(own), 0), np.int64) for _, own, _ in kinds], n
    points = [mesh.points]
    for size in (2, 4, 8):  # edges, quadrilaterals, hexahedra
        rows = [own[:, np.array(f, dtype=np.int64)] for _, own, kind in kinds
                if len(f := [c for c in kind.further if len(c) == size])]
        if not rows:
            continue
        corners = np.sort(np.concatenate([r.reshape(-1, size) for r in rows]), axis=1)
        # one node for all cells with the same corners
        number, first_of, _ = group_equal_rows(corners)
        points.append(mesh.points[corners[first_of]].mean(axis=1))
        if size == 2 and edges is not None and places is not None:
            # edges as single integers, which are sorted as the groups are
            sought, among = (np.sort(e, axis=1) @ np.array([n, 1])
                             for e in (edges, corners[first_of]))
            points[-1][np.searchsorted(among, sought)] = places
        start = 0
        for i, (_, own, kind) in enumerate(kinds):
            count = len(own) * sum(len(c) == size for c in kind.further)
            own_numbers = nodes + number[start : start + count].reshape(len(own), -1)
            further[i] = np.hstack([further[i], own_numbers])
            start += count
        nodes += len(first_of)
    X = np.concatenate(points)
    # nodes inside facets and cells follow the curved edges
    for i, (_, own, kind) in enumerate(kinds):
        W = _inner(kind)
        if len(W) and places is not None:
            X[further[i][:, -len(W):]] = W @ X[np.hstack([own, further[i]])[:, : W.shape[1]]]
    made = replace(mesh, points=X, midpoints=padded(further, [here for here, _, _ in kinds]))
    return replace(made, point_sets={
        name: with_further(made, members, name) for name, members in mesh.point_sets.items()})


def without_midpoints(mesh: Mesh) -> Mesh:
    """Mesh of first order with the corners of one of second order, the first of its points, and a
    note where that straightens edges. away: largest distance of a further node (`midpoints`,
    numbers of points, by cell) from the mean of the corners between which it lies, m."""
    n, away = len(mesh.corners), 0.0
    for here, own in by_kind(mesh.cells, mesh.dimension):
        for i, corners in enumerate(KINDS[mesh.dimension, own.shape[1]].further):
            chord = mesh.points[own[:, list(corners)]].mean(axis=1)
            off = np.linalg.norm(mesh.points[mesh.midpoints[here, i]] - chord, axis=1)
            away = max(away, float(off.max()))
    note = information(f"order: 1 straightens the curved edges of the mesh, by up to {away:.3g} m",
                       "mesh_file")
    bent = away > 1e-9 * float(np.ptp(mesh.points, axis=0).max())
    return replace(mesh, points=mesh.corners, midpoints=mesh.midpoints[:, :0], point_sets={
        name: members[members < n] for name, members in mesh.point_sets.items()},
        notes=(*mesh.notes, *[note] * bent))


def with_further(mesh: Mesh, members: IntArray, name: str = "") -> IntArray:
    """Sorted members of a set of corners with the further nodes of a mesh of second order that
    belong to it; name: of the set, whose facets or cells the mesh may tag.

    Those on the tagged facets, or of the tagged cells, where these have all the members; else those
    between members (`between`) that lie on the boundary or in a cell whose corners all are members
    (`near`). midpoints: numbers of the further nodes of each cell.
    """
    if mesh.order == 1:
        return members
    n = len(mesh.corners)
    facets, cells = mesh.facet_sets.get(name), mesh.cell_sets.get(name)
    rows, _ = cell_facets(mesh.cells, mesh.dimension)
    if facets is not None and len(np.unique(facets)) == len(members):
        found = _on(mesh, rows_among(rows, facets))
    elif cells is not None and len(np.unique(mesh.cells[cells])) == len(members):
        found = np.zeros(len(mesh.points), np.bool_)
        found[mesh.midpoints[cells]] = True
    else:
        inside = np.zeros(len(mesh.points), np.bool_)
        inside[members] = True
        number, count = facet_numbers(rows)
        near, between = _on(mesh, count[number] == 1), np.zeros(len(mesh.points), np.bool_)
        near[mesh.midpoints[inside[mesh.cells].all(axis=1)]] = True
        for here, own in by_kind(mesh.cells, mesh.dimension):
            for i, corners in enumerate(KINDS[mesh.dimension, own.shape[1]].further):
                between[mesh.midpoints[here, i]] = inside[own[:, list(corners)]].all(axis=1)
        found = near & between
    return np.concatenate([members, n + np.flatnonzero(found[n:])])


def _on(mesh: Mesh, chosen: BoolArray) -> BoolArray:
    """(N,) True for further nodes on the chosen ones (R,) of the rows of `cell_facets`."""
    found, start = np.zeros(len(mesh.points), np.bool_), 0
    for here, own in by_kind(mesh.cells, mesh.dimension):
        kind = KINDS[mesh.dimension, own.shape[1]]
        rows = chosen[start : start + len(own) * len(kind.facets)].reshape(len(own), -1)
        start += rows.size
        for facet, there in zip(kind.facets, rows.T, strict=True):
            on = [i for i, corners in enumerate(kind.further) if set(corners) <= set(facet)]
            found[mesh.midpoints[here[there]][:, on]] = True
    return found


def _inner(kind: CellKind) -> FloatArray:
    """(f, p + e) weights of the p corners and e nodes of edges for the nodes inside facets and
    cell: those of serendipity interpolation there, -1/4 of each corner and 2 over the number of
    corners for each edge."""
    p, inner = len(kind.places), kind.further[len(kind.edges):]
    W = np.zeros((len(inner), p + len(kind.edges)))
    for row, corners in zip(W, inner, strict=True):
        row[list(corners)] = -0.25
        own = [p + j for j, edge in enumerate(kind.edges) if set(edge) <= set(corners)]
        row[own] = 2.0 / len(corners)
    return W
