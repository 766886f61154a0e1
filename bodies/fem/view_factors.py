"""View factors between patches of surfaces that radiate diffusely.

A_i F_ij is the area of patch i times the share of its radiation that reaches patch j. In the plane
(per unit depth) it follows from crossed strings (Hottel 1954), in space from the exact view factor
of a point and a polygon (Lambert 1760; Howell, Menguc and Siegel, Thermal Radiation Heat Transfer,
6th ed. 2015, sec. 5.5), integrated over the other patch. What lies behind the horizon of a facet is
cut off. Shadows: the share of rays between two patches that no third facet stops, drawn in
proportion to what the parts of the patches exchange.
"""

from dataclasses import dataclass

import numpy as np

from sparsemor.bodies.fem.integrals import area_vectors
from sparsemor.core import BoolArray, FloatArray, IntArray

NEAR = 2.0
"""Distance of two triangles relative to their size, below which one of them is divided."""
DIVISIONS = 2
"""Number of divisions of such a triangle into four."""
RAYS, CHUNK = 256, 2_000_000
"""Number of rays between two patches that may be shadowed, and of values computed at a time."""
LEVEL = 1e-9
"""Distance from a plane, relative to the size of the surfaces, that is none."""
ENDS = 1e-6
"""Share of a ray at each of its ends where nothing stops it."""
ITERATIONS, BALANCED = 500, 1e-13


@dataclass(frozen=True, slots=True, eq=False)
class Facets:
    """Straight facets: corners (n, d, d), m, d corners each, segments in the plane and triangles in
    space; normals (n, d) of unit length towards where they radiate; areas (n,), m or m2. size:
    extent of all facets, m."""

    corners: FloatArray
    normals: FloatArray
    areas: FloatArray

    @classmethod
    def from_corners(cls, corners: FloatArray) -> "Facets":
        """Facets ordered for outward normals."""
        n = area_vectors(corners) / (corners.shape[2] - 1)
        areas = np.linalg.norm(n, axis=1)
        return cls(corners, n / areas[:, None], areas)

    @property
    def d(self) -> int:
        return int(self.corners.shape[2])

    @property
    def size(self) -> float:
        return float(np.ptp(self.corners.reshape(-1, self.d), axis=0).max())

    def heights(self) -> FloatArray:
        """(n, n, d) distances of the corners of facet j from the plane of facet i."""
        near = self.corners - self.corners.mean(axis=(0, 1))  # no round-off of far places
        levels = (near[:, 0] * self.normals).sum(axis=1)
        found = np.einsum("jcd,id->ijc", near, self.normals) - levels[:, None, None]
        return np.where(np.abs(found) <= LEVEL * self.size, 0.0, found)


def exchange_areas(facets: Facets, patch: IntArray, seed: int) -> FloatArray:
    """A_i F_ij (P, P), m or m2, between patches; patch (n,): number of the patch of each facet;
    seed: of the rays for shadows. S (n, n): between facets without shadows, which are evaluated
    where each has some corner above the plane of the other; sums: of S by patches."""
    heights = facets.heights()
    above = (heights > 0).any(axis=2)
    facing: BoolArray = np.logical_and(above, above.T)
    S = (_strings if facets.d == 2 else _polygons)(facets, heights, facing)
    count = int(patch.max()) + 1
    sums = np.zeros((count, count))
    np.add.at(sums, (patch[:, None], patch[None, :]), S)
    if (heights < 0).any():  # not convex
        sums *= _visible(facets, patch, S, sums, seed)
    return sums


def _strings(facets: Facets, heights: FloatArray, facing: BoolArray) -> FloatArray:
    """A_i F_ij (n, n), m, of segments a = (a0, a1), b = (b0, b1), by crossed strings on the parts
    above each other's horizon: |(|a0 b0| + |a1 b1|) - (|a0 b1| + |a1 b0|)| / 2. heights (n, n, 2):
    of the corners of facet j over the line of facet i; facing (n, n): True for pairs to be
    evaluated."""
    i, j = np.nonzero(facing)
    a, b = facets.corners[i], facets.corners[j]
    b = _above(b, heights[i, j])
    a = _above(a, heights[j, i])

    def length(p: int, q: int) -> FloatArray:
        return np.asarray(np.linalg.norm(a[:, p] - b[:, q], axis=1))

    S = np.zeros(facing.shape)
    S[i, j] = 0.5 * np.abs(length(0, 0) + length(1, 1) - length(0, 1) - length(1, 0))
    return S


def _above(segments: FloatArray, heights: FloatArray) -> FloatArray:
    """Parts of segments (n, 2, 2) with heights >= 0 (n, 2) of their ends."""
    p, q, low, high = segments[:, 0], segments[:, 1], heights[:, 0], heights[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        cut = p + (low / (low - high))[:, None] * (q - p)
    return np.stack([np.where((low < 0)[:, None], cut, p),
                     np.where((high < 0)[:, None], cut, q)], axis=1)


def _polygons(facets: Facets, heights: FloatArray, facing: BoolArray) -> FloatArray:
    """A_i F_ij (n, n), m2, of triangles, by points of one and the whole of the other; the mean of
    both directions. Of near pairs the one is divided for more points. facing (n, n): True for pairs
    to be evaluated; heights: not used, as points below the other's plane (not `up`) count zero and
    a triangle is cut at the horizon of each point."""
    middles = facets.corners.mean(axis=1)
    radius = np.linalg.norm(facets.corners - middles[:, None], axis=2).max(axis=1)
    away = np.linalg.norm(middles[:, None] - middles[None], axis=2)
    near = away < NEAR * (radius[:, None] + radius[None])
    S = np.zeros(facing.shape)
    for level, which in ((0, facing & ~near), (DIVISIONS, facing & near)):
        shares = _points(level)
        i, j = np.nonzero(which)
        step = max(1, CHUNK // (12 * len(shares)))
        for k in range(0, len(i), step):
            here, there = i[k : k + step], j[k : k + step]
            x = np.einsum("pc,ncd->npd", shares, facets.corners[here])
            F = _point_to_triangle(x, facets.normals[here], facets.corners[there])
            up = np.einsum("npd,nd->np", x - facets.corners[there][:, None, 0],
                           facets.normals[there]) > 0.0
            S[here, there] = facets.areas[here] * np.where(up, F, 0.0).mean(axis=1)
    return 0.5 * (S + S.T)


def _points(level: int) -> FloatArray:
    """(p, 3) barycentric coordinates of points of equal weight in a triangle that is divided into
    four `level` times: three in each part, exact for polynomials of second degree."""
    parts = np.eye(3)[None]
    for _ in range(level):
        mid = 0.5 * (parts + parts[:, [1, 2, 0]])  # on the edges 01, 12, 20
        parts = np.concatenate([
            np.stack([parts[:, 0], mid[:, 0], mid[:, 2]], axis=1),
            np.stack([mid[:, 0], parts[:, 1], mid[:, 1]], axis=1),
            np.stack([mid[:, 2], mid[:, 1], parts[:, 2]], axis=1), mid])
    inner = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)
    return np.asarray(np.einsum("qc,pcd->pqd", inner, parts).reshape(-1, 3))


def _point_to_triangle(x: FloatArray, normal: FloatArray, corners: FloatArray) -> FloatArray:
    """View factors (n, p) from points x (n, p, 3) with normals (n, 3) to triangles (n, 3, 3): the
    sum over the edges of angle times normal of the plane through the point, without what lies below
    the horizon of the point."""
    # a triangle is cut at h = 0: `out` where its border goes below, `in` where it comes up again
    r = corners[:, None] - x[:, :, None]  # (n, p, 3 corners, 3)
    h = np.einsum("npcd,nd->npc", r, normal)
    total = np.zeros(x.shape[:2])
    cuts: dict[str, tuple[FloatArray, BoolArray]] = {}
    for k in range(3):
        a, b, low, high = r[:, :, k], r[:, :, (k + 1) % 3], h[:, :, k], h[:, :, (k + 1) % 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = a + (low / (low - high))[..., None] * (b - a)
        down, up = (low > 0) & (high <= 0), (low <= 0) & (high > 0)
        a = np.where(up[..., None], cut, a)
        b = np.where(down[..., None], cut, b)
        total += np.where((low > 0) | (high > 0), _edge(a, b, normal), 0.0)
        for name, where in (("out", down), ("in", up)):
            old, any_ = cuts.get(name, (np.zeros(cut.shape), np.zeros(down.shape, bool)))
            cuts[name] = np.where(where[..., None], cut, old), any_ | where
    (leaves, is_cut), (enters, _) = cuts["out"], cuts["in"]
    total += np.where(is_cut, _edge(leaves, enters, normal), 0.0)  # the edge along the horizon
    return np.abs(total) / (2.0 * np.pi)


def _edge(a: FloatArray, b: FloatArray, normal: FloatArray) -> FloatArray:
    """Angle of two vectors (n, p, 3) at the point, times the component along `normal` (n, 3) of the
    unit vector across both."""
    across = np.cross(a, b)
    size = np.linalg.norm(across, axis=2)
    angle = np.arctan2(size, (a * b).sum(axis=2))
    along = np.einsum("npd,nd->np", across, normal)
    return np.asarray(np.divide(angle * along, size, out=np.zeros(size.shape), where=size > 0.0))


def _visible(
    facets: Facets, patch: IntArray, S: FloatArray, sums: FloatArray, seed: int
) -> FloatArray:
    """Share (P, P) of the rays between two patches that no other facet stops, of `RAYS` for each
    pair of patches; systematic samples of pairs of facets in proportion to S. S (n, n), sums (P,
    P): exchange areas of facets and of patches without shadows; patch (n,): of each facet."""
    members = [np.flatnonzero(patch == p) for p in range(len(sums))]
    found, rng = np.ones(sums.shape), np.random.default_rng(seed)
    for p in range(len(sums)):
        partners = p + np.flatnonzero(sums[p, p:] > 0.0)
        if not len(partners):
            continue
        pairs = []
        for q in partners.tolist():
            # systematic sampling: RAYS equal steps along the cumulated exchange of pairs of facets
            cumulated = np.cumsum(S[np.ix_(members[p], members[q])].ravel())
            at = (np.arange(RAYS) + rng.random()) / RAYS * cumulated[-1]
            pair = np.minimum(np.searchsorted(cumulated, at), len(cumulated) - 1)
            pairs.append((members[p][pair // len(members[q])], members[q][pair % len(members[q])]))
        i, j = (np.concatenate(k) for k in zip(*pairs, strict=True))
        # random points of both facets (uniform barycentric coordinates)
        start, end = (np.einsum("rc,rcd->rd", rng.dirichlet(np.ones(facets.d), len(k)),
                                facets.corners[k]) for k in (i, j))
        above = (((end - start) * facets.normals[i]).sum(axis=1) > 0.0) & (
            ((end - start) * facets.normals[j]).sum(axis=1) < 0.0)  # both horizons
        step = max(1, CHUNK // len(facets.areas))
        stopped = np.concatenate([_stopped(
            facets, start[k : k + step], end[k : k + step], i[k : k + step], j[k : k + step])
            for k in range(0, len(i), step)])
        free, rays = ((a & above).reshape(-1, RAYS).sum(axis=1) for a in (~stopped, above))
        found[p, partners] = found[partners, p] = np.where(rays > 0, free / np.maximum(rays, 1), 1)
    return found


def _stopped(
    facets: Facets, start: FloatArray, end: FloatArray, i: IntArray, j: IntArray
) -> BoolArray:
    """(r,) True for rays from start to end (r, d), on facets i and j (r,), that another facet
    stops: they meet its plane inside of it, at start + s ray with 0 < s < 1, less `ENDS` at both
    ends."""
    ray = end - start
    across = np.einsum("rd,nd->rn", ray, facets.normals)
    gap = np.einsum("rnd,nd->rn", facets.corners[None, :, 0] - start[:, None], facets.normals)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = gap / across
    hit = (s > ENDS) & (s < 1.0 - ENDS)
    hit[np.arange(len(i)), i] = hit[np.arange(len(j)), j] = False
    ray_number, facet = np.nonzero(hit)
    x = start[ray_number] + s[ray_number, facet][:, None] * ray[ray_number]
    x = x - facets.corners[facet, 0]
    sides = facets.corners[facet, 1:] - facets.corners[facet, :1]  # (h, d - 1, d)
    # barycentric coordinates of the point where the ray meets the plane of the facet
    G = np.einsum("had,hbd->hab", sides, sides)
    share = np.linalg.solve(G, np.einsum("had,hd->ha", sides, x)[:, :, None])[:, :, 0]
    inside = (share >= 0.0).all(axis=1) & (share.sum(axis=1) <= 1.0)
    found = np.zeros(len(start), np.bool_)
    found[ray_number[inside]] = True
    return found


def closed(S: FloatArray, areas: FloatArray) -> FloatArray:
    """Symmetric A_i F_ij (P, P) whose rows have the sums A_i, by factors of rows and columns."""
    scale = np.ones(len(S))
    for _ in range(ITERATIONS):
        ratio = areas / (scale * (S @ scale))
        scale *= np.sqrt(ratio)
        if np.abs(ratio - 1.0).max() < BALANCED:
            break
    return np.asarray(scale[:, None] * S * scale)


def bounded(S: FloatArray, areas: FloatArray) -> FloatArray:
    """A_i F_ij (P, P) whose rows have at most the sums A_i."""
    scale = np.minimum(1.0, areas / np.maximum(S.sum(axis=1), 1e-300))
    return np.asarray(np.minimum(scale[:, None], scale) * S)
