"""Contact surface of a body: its facets, their planes, the regions of space nearest to each facet,
its cell, and the search for pairs of close facets of two surfaces.

A cell is the prism over its facet. Where the surface turns by an angle alpha at an edge (in the
plane: at an end of a segment), the side of the prism inclines into the bisecting plane, which both
neighbours share. A coplanar neighbour triangle that touches such an edge with one corner only has
that side too. Cells of polylines tile the neighbourhood; below the corners of curved surfaces in
space they overlap or leave gaps of the order of depth times angle squared.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sparsemor.bodies.fem.integrals import area_vectors
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core import BoolArray, FloatArray, IntArray


def area_slopes(a: FloatArray, n: FloatArray) -> FloatArray:
    """(F, d, d) derivative of area_vectors(a) . n by each corner of facets a (F, d, d), with
    constant n (F, d)."""
    if a.shape[2] == 2:
        r = np.stack([-n[:, 1], n[:, 0]], axis=1)
        return np.stack([-r, r], axis=1)
    opposite = np.roll(a, -1, axis=1) - np.roll(a, -2, axis=1)
    return np.cross(opposite, n[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Planes of F facets: corner 0 (F, d), m; outward unit normal n (F, d); gradients g (F, d, d),
    1/m, of the d barycentric coordinates (second index), tangential to the facet."""

    corner: FloatArray
    n: FloatArray
    g: FloatArray

    @classmethod
    def from_corners(cls, b: FloatArray) -> Self:
        """Planes of facets with corners b (F, d, d), m, ordered for outward normals. N: normals of
        (d - 1)! times the measure; the gradients have the sum 0 (`inner`: those of corners 1
        on)."""
        N = area_vectors(b)
        size = (N * N).sum(axis=1, keepdims=True)
        side = b[:, 1:] - b[:, :1]
        if b.shape[2] == 2:
            inner = side / size[:, None]
        else:
            inner = np.stack([np.cross(side[:, 1], N), np.cross(N, side[:, 0])],
                             axis=1) / size[:, None]
        g = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
        return cls(b[:, 0], N / np.sqrt(size), g)

    def some(self, chosen: IntArray) -> "Planes":
        return Planes(self.corner[chosen], self.n[chosen], self.g[chosen])


FLAT = 1e-9
"""tan(alpha / 2) between neighbours below which they count as coplanar: rounding of a mesh file."""


@dataclass(frozen=True, slots=True, eq=False)
class FacetCells:
    """Cells of F facets, each bounded by B planes.

    A point with barycentric coordinates eta (d,) at distance `depth` (m) below the plane of facet f
    is in the cell if borders[f] @ eta - depth_slopes[f] depth >= 0 for all B. borders (F, B, d);
    depth_slopes (F, B): inclination of the sides; jumps (F, B): True where the traction may be
    discontinuous, because the surface turns or ends there or cells need not tile.
    """

    borders: FloatArray
    depth_slopes: FloatArray
    jumps: BoolArray

    def some(self, chosen: IntArray) -> "FacetCells":
        return FacetCells(self.borders[chosen], self.depth_slopes[chosen], self.jumps[chosen])

    def values(self, eta: FloatArray, depth: FloatArray) -> FloatArray:
        """(P, k, B) values of the border functions of P cells at k points each: eta (P, k, d),
        depth (P, k), m."""
        return np.asarray(eta @ self.borders.transpose(0, 2, 1)
                          - depth[:, :, None] * self.depth_slopes[:, None])


def balls_in_cells(
    middles: FloatArray, radius: FloatArray, planes: Planes, cells: FacetCells, facet: IntArray
) -> IntArray:
    """Numbers of the balls that may intersect the cell of their facet.

    middles (P, d), radius (P,): balls, m; facet (P,): number of the facet of each. A ball farther
    above the facet's plane than its radius is excluded, and one that is farther outside one of the
    facet's own d borders, border function over the norm of its gradient (`_slopes`).
    """
    rel = middles - planes.corner[facet]
    depth = -np.einsum("pk,pk->p", rel, planes.n[facet])
    ok = depth > -radius
    for border, slope in enumerate(_slopes(planes, cells).T):
        value = np.einsum("pk,pk->p", rel, planes.g[facet, border]) + (border == 0)
        value -= cells.depth_slopes[facet, border] * depth
        ok &= value > -radius * slope[facet]
    return np.flatnonzero(ok)


def _slopes(planes: Planes, cells: FacetCells) -> FloatArray:
    """(F, d), 1/m: gradient norms of the border functions of each facet's own edges."""
    sizes = np.linalg.norm(planes.g, axis=2)
    return np.asarray(np.hypot(sizes, cells.depth_slopes[:, : sizes.shape[1]]))


def cells_of(X: FloatArray, facets: IntArray, planes: Planes) -> FacetCells:
    """Cells of facets (F, d), node numbers of points X (n, d), m: the prism over each facet, whose
    sides incline by `turns` = tan(alpha / 2) at edges where the surface turns by alpha, positive
    where it is convex, so that cells get narrower with depth. other (F, d): neighbour at the edge
    opposite each corner, -1 for none. Own borders: barycentric coordinate
    eta_i minus inclination times depth >= 0; in space also those of edges that a corner touches
    (`_shared`).
    """
    other, (F, d) = neighbours(facets), facets.shape
    turns = _turns(X, facets, planes, other)
    own = np.broadcast_to(np.eye(d), (F, d, d)), turns * np.linalg.norm(planes.g, axis=2)
    if d == 2:
        return FacetCells(*own, (other < 0) | (turns != 0))
    facet, border, depth_slope = _shared(X, facets, planes, other, turns)
    # the three own borders, then as many additional ones as the facet with most of them has
    count = np.bincount(facet, minlength=F)
    rank = np.arange(len(facet)) - (np.cumsum(count) - count)[facet]
    borders = np.ones((F, 3 + int(count.max(initial=0)), 3))  # never below 0 where there is none
    depth_slopes = np.zeros(borders.shape[:2])
    borders[:, :3], depth_slopes[:, :3] = own
    borders[facet, 3 + rank], depth_slopes[facet, 3 + rank] = border, depth_slope
    corners = np.zeros(len(X), bool)  # at an end of a turned edge
    for end in (1, 2):
        corners[np.roll(facets, -end, axis=1)[turns != 0]] = True
    jumps = np.repeat(corners[facets].any(axis=1, keepdims=True), borders.shape[1], axis=1)
    jumps[:, :3] |= other < 0
    return FacetCells(borders, depth_slopes, jumps)


def neighbours(facets: IntArray) -> IntArray:
    """(F, d) number of the facet that shares the edge (in the plane: the end) opposite each corner;
    -1 if there is none. Facets (F, d), node numbers, are ordered for outward normals: neighbours
    run along a shared edge in opposite directions."""
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
    """(F, d) tan(alpha / 2) at the edge opposite each corner, positive for convex edges."""
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
    """Additional borders for triangles that touch a turned edge with one corner only, are coplanar
    with the triangle of that edge and lie on its inner side.

    Returns facet (s,), sorted, border (s, 3), m, and inclination (s,), as in `FacetCells`. other
    (F, 3): neighbour at the edge opposite each corner, -1 for none; turns (F, 3): inclination
    there, 0 where both are coplanar.
    """
    F = len(facets)
    facet, edge = np.nonzero((other >= 0) & (turns == 0))
    flat = csr_array((np.ones(len(facet)), (facet, other[facet, edge])), shape=(F, F))
    _, patch = connected_components(flat, directed=False)  # coplanar triangles
    # turned edges, each of its owner, and the triangles of its patch at either of its ends
    owner, edge = np.nonzero(turns)
    ends = [np.roll(facets, -k, axis=1)[owner, edge] for k in (1, 2)]
    at = csr_array((np.ones(3 * F), (facets.ravel(), np.repeat(np.arange(F), 3))),
                   shape=(len(X), F))
    pairs = [at[e].tocoo() for e in ends]
    which = np.concatenate([p.row for p in pairs])
    facet = np.concatenate([p.col for p in pairs])
    kept = (patch[facet] == patch[owner[which]]) & (facet != owner[which])
    which, facet = which[kept], facet[kept]
    # distance of their corners from the edge, inwards: a border if none is beyond it
    g = planes.g[owner, edge]
    inward = (g / np.linalg.norm(g, axis=1, keepdims=True))[which]
    border = ((X[facets[facet]] - X[ends[0][which]][:, None]) * inward[:, None]).sum(axis=2)
    size = np.abs(border).max(axis=1)
    inner = border.min(axis=1) >= -1e-9 * size
    facet, border, size = facet[inner], border[inner], size[inner]
    depth_slope = turns[owner, edge][which][inner]
    # one of the borders that a triangle has twice, from both ends of an edge or from edges in line
    key = np.round(np.concatenate([border / size[:, None], depth_slope[:, None]], axis=1), 9)
    _, first = np.unique(np.concatenate([facet[:, None], key], axis=1), axis=0, return_index=True)
    return facet[first], border[first], depth_slope[first]


@dataclass(frozen=True, eq=False)
class Surface:
    """Contact surface: facets of the boundary of a body.

    nodes (n,): sorted node numbers of the body; facets (F, d): corners as positions in `nodes`,
    ordered for outward normals; cells: regions nearest to each undeformed facet; radius: largest
    distance of a corner from the centroid of its facet, m, over the whole surface also in a copy
    with a part of the facets.
    """

    body: FloatingBody
    nodes: IntArray
    facets: IntArray
    cells: FacetCells
    radius: float

    @classmethod
    def from_facets(cls, body: FloatingBody, facets: IntArray) -> Self:
        """Surface of facets (F, d), node numbers of the body, ordered for outward normals."""
        nodes = np.unique(facets)
        at = np.searchsorted(nodes, facets)
        X = body.X[nodes]
        cells = cells_of(X, at, Planes.from_corners(X[at]))
        return cls(body, nodes, at, cells, float(radii_of(X[at]).max()))

    def some(self, chosen: IntArray) -> tuple[Self, IntArray]:
        """Copy with the facets `chosen` only, and the positions (m,) of their nodes in `nodes`.

        The cells are those of the whole surface.
        """
        used = np.unique(self.facets[chosen])
        return type(self)(self.body, self.nodes[used], np.searchsorted(used, self.facets[chosen]),
                          self.cells.some(chosen), self.radius), used

    def cells_at(self, chosen: IntArray, planes: Planes) -> FacetCells:
        """Cells of the facets `chosen` in a deformed state, where `planes` are the facets' planes.

        In the plane the borders between cells keep their angle when a segment is stretched; in
        space they keep their slope in barycentric coordinates. stretch: undeformed length of each
        segment over its present one, by the gradients g of barycentric coordinates, 1/m.
        """
        cells = self.cells.some(chosen)
        if self.d == 3:
            return cells
        g, g0 = planes.g[:, :1], self.planes.g[chosen, :1]
        stretch = np.sqrt((g * g).sum(axis=2) / (g0 * g0).sum(axis=2))
        return FacetCells(cells.borders, cells.depth_slopes * stretch, cells.jumps)

    @property
    def d(self) -> int:
        """Space dimension: 2 in the plane, 3 in space."""
        return int(self.facets.shape[1])

    @cached_property
    def X(self) -> FloatArray:
        """(n, d) reference positions, m."""
        return self.body.X[self.nodes]

    @cached_property
    def sizes(self) -> FloatArray:
        """(F,) length of the shortest edge of each facet, m."""
        corners = self.X[self.facets]
        edges = corners - np.roll(corners, -1, axis=1)
        return np.asarray(np.linalg.norm(edges, axis=2).min(axis=1))

    @cached_property
    def radii(self) -> FloatArray:
        """(F,) largest distance of each facet's corners from its centroid, m."""
        return radii_of(self.X[self.facets])

    @cached_property
    def tree(self) -> Any:
        """Search tree over the centroids of the undeformed facets, in the body frame."""
        return tree_of(self.X, self.facets)

    @cached_property
    def planes(self) -> Planes:
        """Planes of the undeformed facets, in the body frame."""
        return Planes.from_corners(self.X[self.facets])


def radii_of(corners: FloatArray) -> FloatArray:
    """(F,) largest distance of a corner from the centroid, m, of facets with corners (F, d, d)."""
    away = corners - corners.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(away, axis=2).max(axis=1))


def tree_of(z: FloatArray, facets: IntArray) -> Any:
    """Search tree over the centroids of facets (F, d), whose nodes are at z (n, d), m."""
    return cKDTree(z[facets].mean(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class BroadPhase:
    """Search for facet pairs whose bounding circles or spheres, enlarged by a length `reach` (m),
    intersect.

    radius: search radius between centroids, m; most: largest number of centroids of the undeformed
    second surface within the radius of any point (an upper bound).
    """

    radius: float
    most: int

    @classmethod
    def between(cls, first: Surface, second: Surface, reach: float) -> "BroadPhase":
        radius = first.radius + second.radius + reach
        # a ball that holds one middle at all lies in the ball of twice the radius about it
        held = second.tree.query_ball_point(second.tree.data, 2.0 * radius, return_length=True)
        return cls(radius, int(held.max()))

    def pairs(self, middles: FloatArray, tree: Any) -> tuple[IntArray, IntArray]:
        """Pairs of close facets, sorted: positions in `middles` (m, d), the centroids of first
        facets, m, and facet numbers in `tree`, the search tree of the second surface."""
        _, found = tree.query(middles, k=np.arange(1, self.most + 1),
                              distance_upper_bound=self.radius)
        here, rank = np.nonzero(found < tree.n)
        return here, found[here, rank]
