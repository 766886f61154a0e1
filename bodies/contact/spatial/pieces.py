"""Where triangles of two surfaces overlap, cut into pieces on which the pressure is smooth.

Everything is seen from the second body's axes. A place on the first triangle is s (3,) barycentric.
Projected on the second one it has barycentric numbers eta, and it lies the penetration d below it.
With corners a, b of the two, n the second one's normal and g the gradients of eta, the velocity of
the first body's point against the second body's is

    w = sum s a' - sum eta b' - d sum g (n . b'),

where the last part is the turn of the second triangle: the second body's point is on a rigid arm of
the length d. The penetration's rate is -n . w, the slip is the rest of w. All of d, eta and w are
linear in s.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.bodies.contact.spatial.cells import Cells
from sparsemor.bodies.contact.spatial.planes import Planes
from sparsemor.bodies.contact.spatial.polygons import NONE, Polygons, fans, joined
from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.protocols import NormalLaw

EDGE = 1_000_000
"""Tag of an edge where the surfaces lift off; lower ones: the number of the cell's border."""
DEPTH, SINK, SLIP, ETA = 0, 1, slice(2, 5), slice(5, 8)
"""Columns of `Overlaps.at`."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Of pairs of facets in the second body's axes: corners a and their velocities va (P, 3, 3) of
    the first; planes, cells and velocities vb (P, 3, 3; None: at rest) of the second."""

    a: FloatArray
    va: FloatArray
    planes: Planes
    cells: Cells
    vb: FloatArray | None = None

    def some(self, chosen: IntArray) -> "Pairs":
        vb = None if self.vb is None else self.vb[chosen]
        return Pairs(self.a[chosen], self.va[chosen], self.planes.some(chosen),
                     self.cells.some(chosen), vb)

    def seen(self) -> tuple[FloatArray, FloatArray]:
        """Penetration (P, 3) and eta (P, 3, 3: corner of the first, number) at the corners."""
        rel = self.a - self.planes.corner[:, None]
        eta = rel @ self.planes.g.transpose(0, 2, 1)
        eta[:, :, 0] += 1.0
        return np.asarray(-(rel @ self.planes.n[:, :, None])[:, :, 0]), eta

    def measure(self) -> FloatArray:
        """(P,), m2: twice the area of the first triangle in projection on the second one."""
        N = np.cross(self.a[:, 1] - self.a[:, 0], self.a[:, 2] - self.a[:, 0])
        return np.asarray(-(N * self.planes.n).sum(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """Parts of first triangles in contact. at (P, 3, 8): penetration (m), its rate, slip (m/s, 3)
    and eta (3) at the corners; measure (P,), m2, of the area on the second surface."""

    pairs: Pairs
    polygons: Polygons
    at: FloatArray
    measure: FloatArray

    @classmethod
    def of(cls, pairs: Pairs) -> tuple[Self, IntArray]:
        """The overlaps that are not empty, and which of the pairs they are of."""
        depth, eta = pairs.seen()
        borders = pairs.cells.values(eta, depth)
        # surfaces that look the same way are the far sides of the bodies
        some = _reaching(depth, borders)
        some = some[pairs.some(some).measure() > 0]
        pairs, depth, eta, borders = pairs.some(some), depth[some], eta[some], borders[some]
        polygons = Polygons.whole(len(some))
        for tag in range(borders.shape[2]):
            polygons = polygons.cut(polygons.values(borders[:, :, tag]), tag)
        polygons = polygons.cut(polygons.values(depth), EDGE)
        kept = np.flatnonzero(polygons.count > 0)
        pairs, depth, eta = pairs.some(kept), depth[kept], eta[kept]
        n = pairs.planes.n
        w = relative(pairs, depth, eta)
        sink = -(w @ n[:, :, None])
        slip = w + sink * n[:, None]
        at = np.concatenate([depth[:, :, None], sink, slip, eta], axis=2)
        return cls(pairs, polygons.some(kept), at, pairs.measure()), some[kept]

    def values(self, of: IntArray, s: FloatArray) -> FloatArray:
        """(N, q, 8) at places s (N, q, 3) of overlaps `of` (N,)."""
        return np.asarray(s @ self.at[of])


def _reaching(depth: FloatArray, borders: FloatArray) -> IntArray:
    """Pairs of which no border of the overlap has all three corners outside."""
    ok = np.maximum(np.maximum(depth[:, 0], depth[:, 1]), depth[:, 2]) >= 0
    reach = np.maximum(np.maximum(borders[:, 0], borders[:, 1]), borders[:, 2]) > 0
    for border in range(reach.shape[1]):
        ok &= reach[:, border]
    return np.flatnonzero(ok)


def relative(pairs: Pairs, depth: FloatArray, eta: FloatArray) -> FloatArray:
    """(P, 3, 3) velocity w at the corners of the first triangle."""
    if pairs.vb is None:
        return pairs.va
    swing = pairs.planes.g.transpose(0, 2, 1) @ (pairs.vb @ pairs.planes.n[:, :, None])
    return np.asarray(pairs.va - eta @ pairs.vb - depth[:, :, None] * swing.transpose(0, 2, 1))


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Polygons of overlaps `of` (N,) on which the pressure is smooth, and the triangles that they
    are made of: piece (M,), corners (M, 3, 3) barycentric, size (M,) (see `fans`)."""

    of: IntArray
    polygons: Polygons
    piece: IntArray
    corners: FloatArray
    size: FloatArray

    @classmethod
    def cut(cls, o: Overlaps, normal: NormalLaw) -> Self:
        """Split where the normal law has a break, and where the pressure would change its sign."""
        found: list[tuple[IntArray, Polygons]] = []
        of, rest = np.arange(len(o.measure)), o.polygons
        for level in normal.breaks:
            depth = rest.values(o.at[of, :, DEPTH])
            found.append(_left(of, rest.cut(level - depth, NONE)))
            of, rest = _left(of, rest.cut(depth - level, NONE))
        found.append((of, rest))
        of, polygons = np.concatenate([f for f, _ in found]), joined([p for _, p in found])
        of, polygons = _signed(o, of, polygons, normal)
        return cls(of, polygons, *fans(polygons))

    @property
    def overlap(self) -> IntArray:
        """(M,) of each triangle."""
        return self.of[self.piece]

    def samples(self, points: FloatArray) -> FloatArray:
        """(M, q, 3) places of points (q, 3) of each triangle."""
        return np.asarray(points @ self.corners)


def _left(of: IntArray, polygons: Polygons) -> tuple[IntArray, Polygons]:
    some = np.flatnonzero(polygons.count > 0)
    return of[some], polygons.some(some)


def pressure(o: Overlaps, of: IntArray, s: FloatArray, normal: NormalLaw) -> FloatArray:
    """(N, q) what the law says, negative where it would pull."""
    at = (s @ o.at[of][:, :, :2])
    return normal.pressure(np.maximum(at[:, :, DEPTH], 0.0), at[:, :, SINK])[0]


def _signed(
    o: Overlaps, of: IntArray, polygons: Polygons, normal: NormalLaw
) -> tuple[IntArray, Polygons]:
    """Pieces of one sign of the pressure. Between its roots on two edges the border is a straight
    line, and in the layer where the damping sets in nearly so."""
    p = pressure(o, of, polygons.places, normal)
    used = polygons.used
    mixed = (used & (p > 0)).any(axis=1) & (used & (p < 0)).any(axis=1)
    if not mixed.any():
        return of, polygons
    some = np.flatnonzero(mixed)
    both, p = polygons.some(some), p[some]
    share = _roots(o, of[some], both, p, normal)
    rest = np.flatnonzero(~mixed)
    parts = [(of[rest], polygons.some(rest))]
    parts += [_left(of[some], both.cut(sign * p, NONE, share)) for sign in (1.0, -1.0)]
    return np.concatenate([f for f, _ in parts]), joined([q for _, q in parts])


def _roots(
    o: Overlaps, of: IntArray, polygons: Polygons, p: FloatArray, normal: NormalLaw
) -> FloatArray:
    """(N, V) where along each edge the pressure vanishes, by bisection to round-off."""
    ends = np.take_along_axis(polygons.places, polygons.following()[:, :, None], axis=1)
    low, high = np.zeros(p.shape), np.ones(p.shape)
    start: BoolArray = p >= 0
    for _ in range(52):
        middle = 0.5 * (low + high)
        s = polygons.places + middle[:, :, None] * (ends - polygons.places)
        same = (pressure(o, of, s, normal) >= 0) == start
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)
