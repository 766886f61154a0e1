"""Cells of facets: the parts of a surface's neighbourhood whose nearest facet is the same.

A cell is the prism over its facet. Where the surface turns by alpha at an edge (in the plane: at an
end of a segment), the border leans into the plane that halves the angle, which two neighbours
share; a triangle that only touches such an edge with a corner, in one plane with the edge's owner,
has that border too. Cells of polylines tile the neighbourhood; below the corners of curved surfaces
in space they overlap or leave gaps by the square of depth times turn, no more.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from sparsemor.bodies.contact.planes import Planes
from sparsemor.core import BoolArray, FloatArray, IntArray

FLAT = 1e-9
"""tan(alpha / 2) between neighbours below which they count as one plane: rounding of a mesh file.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """A point with barycentric numbers eta, d below a facet's plane, is in the cell where all of
    borders (F, B, d) . eta - leans (F, B) d are at least 0. jumps (F, B): borders at which the
    traction may jump, because the surface turns or ends there or cells need not tile."""

    borders: FloatArray
    leans: FloatArray
    jumps: BoolArray

    def some(self, chosen: IntArray) -> "Cells":
        return Cells(self.borders[chosen], self.leans[chosen], self.jumps[chosen])

    def values(self, eta: FloatArray, depth: FloatArray) -> FloatArray:
        """(P, k, B) of the borders at eta (P, k, d) and depth (P, k) of as many cells."""
        return np.asarray(eta @ self.borders.transpose(0, 2, 1)
                          - depth[:, :, None] * self.leans[:, None])


def reached(
    middles: FloatArray, radius: FloatArray, planes: Planes, cells: Cells, facet: IntArray
) -> IntArray:
    """Balls, with middles (P, d) and radius (P,), that may touch the cell of their facet (P,): no
    higher above its plane than they are wide."""
    rel = middles - planes.corner[facet]
    depth = -np.einsum("pk,pk->p", rel, planes.n[facet])
    ok = depth > -radius
    for border, slope in enumerate(_slopes(planes, cells).T):
        value = np.einsum("pk,pk->p", rel, planes.g[facet, border]) + (border == 0)
        value -= cells.leans[facet, border] * depth
        ok &= value > -radius * slope[facet]
    return np.flatnonzero(ok)


def _slopes(planes: Planes, cells: Cells) -> FloatArray:
    """(F, d), 1/m: gradient norms of the d border functions of the facet's own edges."""
    sizes = np.linalg.norm(planes.g, axis=2)
    return np.asarray(np.hypot(sizes, cells.leans[:, : sizes.shape[1]]))


def cells_of(X: FloatArray, facets: IntArray, planes: Planes) -> Cells:
    """Of facets (F, d) of points X (n, d)."""
    other, (F, d) = neighbours(facets), facets.shape
    turns = _turns(X, facets, planes, other)
    own = np.broadcast_to(np.eye(d), (F, d, d)), turns * np.linalg.norm(planes.g, axis=2)
    if d == 2:
        return Cells(*own, (other < 0) | (turns != 0))
    facet, border, lean = _shared(X, facets, planes, other, turns)
    count = np.bincount(facet, minlength=F)
    rank = np.arange(len(facet)) - (np.cumsum(count) - count)[facet]
    borders = np.ones((F, 3 + int(count.max(initial=0)), 3))  # never below 0 where there is none
    leans = np.zeros(borders.shape[:2])
    borders[:, :3], leans[:, :3] = own
    borders[facet, 3 + rank], leans[facet, 3 + rank] = border, lean
    corners = np.zeros(len(X), bool)
    for end in (1, 2):
        corners[np.roll(facets, -end, axis=1)[turns != 0]] = True
    jumps = np.repeat(corners[facets].any(axis=1, keepdims=True), borders.shape[1], axis=1)
    jumps[:, :3] |= other < 0
    return Cells(borders, leans, jumps)


def neighbours(facets: IntArray) -> IntArray:
    """(F, d) number of the facet across the edge (the end) opposite each corner, -1: none."""
    n = int(facets.max()) + 1
    if facets.shape[1] == 2:
        starts, stops = np.full((2, n), -1)
        starts[facets[:, 0]] = stops[facets[:, 1]] = np.arange(len(facets))
        return np.stack([starts[facets[:, 1]], stops[facets[:, 0]]], axis=1)
    start, stop = np.roll(facets, -1, axis=1), np.roll(facets, -2, axis=1)
    there, back = (start * n + stop).ravel(), (stop * n + start).ravel()
    order = np.argsort(there)
    at = np.minimum(np.searchsorted(there, back, sorter=order), len(order) - 1)
    found = order[at]
    return np.where(there[found] == back, found // 3, -1).reshape(facets.shape)


def _turns(X: FloatArray, facets: IntArray, planes: Planes, other: IntArray) -> FloatArray:
    """(F, d): tan(alpha / 2) at the edge opposite each corner, positive where it is convex."""
    facet, edge = np.nonzero(other >= 0)
    far = other[facet, edge]
    n, m = planes.n[facet], planes.n[far]
    step = X[facets[far]].mean(axis=1) - X[facets[facet]].mean(axis=1)
    fold = np.maximum(np.linalg.norm(n + m, axis=1), 1e-15)  # 0 at the tip of a crack
    bend = np.linalg.norm(n - m, axis=1) / fold
    found = np.zeros(facets.shape)
    found[facet, edge] = np.where(bend < FLAT, 0.0, np.sign(-(n * step).sum(axis=1)) * bend)
    return found


def _shared(
    X: FloatArray, facets: IntArray, planes: Planes, other: IntArray, turns: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Borders of turned edges for facets that touch these with a corner alone, in one plane with
    the owner and on the inner side of the edge: facet (s,), sorted, border (s, 3), lean (s,)."""
    F = len(facets)
    facet, edge = np.nonzero((other >= 0) & (turns == 0))
    flat = csr_array((np.ones(len(facet)), (facet, other[facet, edge])), shape=(F, F))
    _, patch = connected_components(flat, directed=False)
    owner, edge = np.nonzero(turns)
    ends = [np.roll(facets, -k, axis=1)[owner, edge] for k in (1, 2)]
    at = csr_array((np.ones(3 * F), (facets.ravel(), np.repeat(np.arange(F), 3))),
                   shape=(len(X), F))
    pairs = [at[e].tocoo() for e in ends]
    which = np.concatenate([p.row for p in pairs])
    facet = np.concatenate([p.col for p in pairs])
    kept = (patch[facet] == patch[owner[which]]) & (facet != owner[which])
    which, facet = which[kept], facet[kept]
    g = planes.g[owner, edge]
    inward = (g / np.linalg.norm(g, axis=1, keepdims=True))[which]
    border = ((X[facets[facet]] - X[ends[0][which]][:, None]) * inward[:, None]).sum(axis=2)
    size = np.abs(border).max(axis=1)
    inner = border.min(axis=1) >= -1e-9 * size
    facet, border, size = facet[inner], border[inner], size[inner]
    lean = turns[owner, edge][which][inner]
    key = np.round(np.concatenate([border / size[:, None], lean[:, None]], axis=1), 9)
    _, first = np.unique(np.concatenate([facet[:, None], key], axis=1), axis=0, return_index=True)
    return facet[first], border[first], lean[first]
