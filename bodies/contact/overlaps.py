"""Overlaps of facets of two surfaces, cut into pieces on which the tractions are smooth.

All vectors are in the second body's axes; facets are segments (d = 2) or triangles (d = 3). A point
of the first facet has barycentric coordinates s (d,); its projection on the second facet has
barycentric coordinates eta, and it lies the penetration delta below that facet. With corners a, b
of the two facets, the normal n of the second one and the gradients g of eta, the velocity of the
first body's point relative to the second body's is

    w = sum s a' - sum eta b' - delta sum g (n . b'),

where the last term is due to the rotation of the second facet: the second body's point is on a
rigid arm of length delta. The penetration rate is -n . w, the slip is the tangential part of w. All
of delta, eta and w are linear in s: resultants are smooth functions of the motion although the edge
of contact moves.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.bodies.contact.clipping import NONE, Parts, joined, nonempty
from sparsemor.bodies.contact.surface import FacetCells, Planes
from sparsemor.bodies.fem.integrals import area_vectors
from sparsemor.core import BoolArray, FloatArray, FrictionLaw, IntArray, NormalLaw

EDGE = 1_000_000
"""Tag of an edge where the surfaces lift off; smaller tags are the number of the cell's border."""
DEPTH, SINK = 0, 1
"""Columns of penetration and penetration rate in `Overlaps.at`, followed by those of slip and eta.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """P pairs of facets in the second body's axes.

    a, va (P, d, d): corners of the first facet, m, and their velocities, m/s; planes, cells: of the
    second facet, with corner 0, unit normal n (outwards) and gradients g of its barycentric
    coordinates; vb (P, d, d): velocities of its corners, None if at rest.
    """

    a: FloatArray
    va: FloatArray
    planes: Planes
    cells: FacetCells
    vb: FloatArray | None = None

    def some(self, chosen: IntArray) -> "Pairs":
        vb = None if self.vb is None else self.vb[chosen]
        return Pairs(self.a[chosen], self.va[chosen], self.planes.some(chosen),
                     self.cells.some(chosen), vb)

    def projected(self) -> tuple[FloatArray, FloatArray]:
        """Penetration (P, d), m, at the corners of the first facet, and their barycentric
        coordinates eta (P, d, d) (second index: corner) in the second facet."""
        rel = self.a - self.planes.corner[:, None]
        eta = rel @ self.planes.g.transpose(0, 2, 1)
        eta[:, :, 0] += 1.0
        return np.asarray(-(rel @ self.planes.n[:, :, None])[:, :, 0]), eta

    def measure(self) -> FloatArray:
        """(P,) (d - 1)! times the length (m) or area (m2) of the first facet projected on the
        second one, positive where their outward normals are opposite."""
        return np.asarray(-(area_vectors(self.a) * self.planes.n).sum(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """Parts of first facets in contact with a second facet.

    parts: the overlaps in barycentric coordinates of the first facet; at (P, d, 2 + 2 d):
    penetration (m), its rate (m/s), slip (m/s, d) and eta (d) at the first facet's corners, with
    bristles (2 + 4 d) their deflections over the limit and the rates, m/s; measure (P,), m or m2:
    see `Pairs.measure`.
    """

    pairs: Pairs
    parts: Parts
    at: FloatArray
    measure: FloatArray

    @classmethod
    def from_pairs(cls, pairs: Pairs) -> tuple[Self, IntArray]:
        """The nonempty overlaps of facet pairs, and the numbers of their pairs. depth, eta: of the
        first facet's corners below the second facet, m, and projected on it; borders: functions
        that are positive in its cell; w: relative velocity, sink = -n . w the penetration rate;
        _reaching: numbers of pairs that may overlap; tags: cell's border on which an edge lies,
        `EDGE` where the surfaces lift off (depth 0)."""
        depth, eta = pairs.projected()
        borders, measure = pairs.cells.values(eta, depth), pairs.measure()
        # surfaces that look the same way are the far sides of the bodies
        some = _reaching(depth, borders, measure)
        # an overlap is where the point is in the cell and below the plane of the second facet
        bounds = np.concatenate([borders[some], depth[some, :, None]], axis=2)
        tags = np.arange(bounds.shape[2])
        tags[-1] = EDGE
        parts = Parts.within(bounds, tags)
        within = np.flatnonzero(parts.count > 0)
        kept = some[within]
        pairs, depth, eta = pairs.some(kept), depth[kept], eta[kept]
        n = pairs.planes.n
        w = relative(pairs, depth, eta)
        sink = -(w @ n[:, :, None])
        slip = w + sink * n[:, None]
        at = np.concatenate([depth[:, :, None], sink, slip, eta], axis=2)
        return cls(pairs, parts.some(within), at, measure[kept]), kept

    @property
    def d(self) -> int:
        return int(self.at.shape[1])

    @property
    def slip_columns(self) -> slice:
        """Columns of `at` with the slip."""
        return slice(2, 2 + self.d)

    @property
    def eta_columns(self) -> slice:
        """Columns of `at` with the projections eta; those of bristles begin where it stops."""
        return slice(2 + self.d, 2 + 2 * self.d)

    @property
    def speed(self) -> FloatArray:
        """(P, 2) slip speed along the second facet at the corners, m/s, for contact in the plane.
        """
        n, slip = self.pairs.planes.n, self.at[:, :, self.slip_columns]
        return np.asarray(slip[:, :, 1] * n[:, :1] - slip[:, :, 0] * n[:, 1:])


def _reaching(depth: FloatArray, borders: FloatArray, measure: FloatArray) -> IntArray:
    """Numbers of the pairs that face each other and have, for each border of the overlap, a corner
    of the first facet inside it."""
    deepest, reach = depth[:, 0], borders[:, 0]
    for corner in range(1, depth.shape[1]):  # quicker than along rows of a few numbers
        deepest = np.maximum(deepest, depth[:, corner])
        reach = np.maximum(reach, borders[:, corner])
    ok = (deepest >= 0) & (measure > 0)
    for border in reach.T:
        ok &= border > 0
    return np.flatnonzero(ok)


def relative(pairs: Pairs, depth: FloatArray, eta: FloatArray) -> FloatArray:
    """(P, d, d) relative velocity w (module docstring), m/s, at the corners of the first facet.

    depth (P, d): penetration; eta (P, d, d): projections.
    """
    if pairs.vb is None:
        return pairs.va
    # minus the rate of the normal: sum g (n . b')
    swing = pairs.planes.g.transpose(0, 2, 1) @ (pairs.vb @ pairs.planes.n[:, :, None])
    return np.asarray(pairs.va - eta @ pairs.vb - depth[:, :, None] * swing.transpose(0, 2, 1))


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Parts of overlaps on which the tractions are smooth, and their triangulation.

    of (N,): number of the overlap of each part, sorted; piece (M,), corners (M, d, d), size (M,):
    part number, barycentric corners in the first facet, and size relative to it, of each segment or
    triangle (`Parts.simplices`).
    """

    of: IntArray
    parts: Parts
    piece: IntArray
    corners: FloatArray
    size: FloatArray

    @classmethod
    def cut(cls, o: Overlaps, normal: NormalLaw, friction: FrictionLaw | None) -> Self:
        """Splits overlaps where the normal law is not smooth (its `breaks`) and where the pressure
        would change its sign; in the plane, where the slip speed is linear, also at the breaks of
        the friction law."""
        cuts = [(o.at[:, :, DEPTH], level) for level in normal.breaks]
        if friction is not None and o.d == 2:
            cuts += [(o.speed, level) for level in friction.breaks]
        of, parts = _signed(o, *o.parts.split(cuts), normal)
        return cls(of, parts, *parts.simplices())

    @property
    def overlap(self) -> IntArray:
        """(M,) number of the overlap of each simplex, sorted."""
        return self.of[self.piece]

    def samples(self, points: FloatArray) -> FloatArray:
        """(M, q, d) barycentric coordinates in the first facet of the points (q, d) of a quadrature
        rule in each simplex."""
        return np.asarray(points @ self.corners)


def pressure(o: Overlaps, of: IntArray, s: FloatArray, normal: NormalLaw) -> FloatArray:
    """(N, q) pressure of the normal law at points s (N, q, d) of the overlaps `of` (N,), Pa;
    negative where the law gives tension."""
    at = s @ o.at[of, :, :2]
    return normal.pressure(np.maximum(at[:, :, DEPTH], 0.0), at[:, :, SINK])[0]


def _signed(
    o: Overlaps, of: IntArray, parts: Parts, normal: NormalLaw
) -> tuple[IntArray, Parts]:
    """Splits parts where the pressure changes its sign; of: overlap of each part.

    The zero line between its roots on two edges is straight, or nearly so in the layer over which
    the damping increases. Returns the overlap of each part, sorted, and the parts.
    """
    p = pressure(o, of, parts.corners, normal)
    used = parts.used
    mixed = (used & (p > 0)).any(axis=1) & (used & (p < 0)).any(axis=1)
    if not mixed.any():
        return of, parts
    some, rest = np.flatnonzero(mixed), np.flatnonzero(~mixed)
    both, p = parts.some(some), p[some]
    share = _roots(o, of[some], both, p, normal)
    found = [(of[rest], parts.some(rest))]
    found += [nonempty((of[some], both.cut(sign * p, NONE, share))) for sign in (1.0, -1.0)]
    return joined(found)


def _roots(
    o: Overlaps, of: IntArray, parts: Parts, p: FloatArray, normal: NormalLaw
) -> FloatArray:
    """(N, V) position of the zero of the pressure on the edge from each corner of the parts to the
    next, from 0 to 1, by bisection to round-off; any where it has no zero. of (N,): overlap of each
    part; p (N, V): pressure at the corners, Pa."""
    ends = np.take_along_axis(parts.corners, parts.following()[:, :, None], axis=1)
    low, high = np.zeros(p.shape), np.ones(p.shape)
    start: BoolArray = p >= 0
    for _ in range(52):
        middle = 0.5 * (low + high)
        s = parts.corners + middle[:, :, None] * (ends - parts.corners)
        same = (pressure(o, of, s, normal) >= 0) == start
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)
