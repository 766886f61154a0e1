"""Overlaps of facets of two surfaces, cut into pieces on which the tractions are smooth.

Everything is in the second body's axes, for segments (d = 2) and triangles (d = 3) alike. A place
on the first facet is s (d,) barycentric. Projected on the second one it has barycentric numbers
eta, and it lies the penetration delta below it. With corners a, b of the two, n the second one's
normal and g the gradients of eta, the velocity of the first body's point against the second's is

    w = sum s a' - sum eta b' - delta sum g (n . b'),

where the last part is the turn of the second facet: the second body's point is on a rigid arm of
the length delta. The penetration's rate is -n . w, the slip is the rest of w. All of delta, eta and
w are linear in s: resultants are smooth functions of the motion although the edge of contact moves.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.bodies.contact.cells import Cells
from sparsemor.bodies.contact.clipping import NONE, Parts, joined, left
from sparsemor.bodies.contact.planes import Planes, area_vector
from sparsemor.core import BoolArray, FloatArray, FrictionLaw, IntArray, NormalLaw

EDGE = 1_000_000
"""Tag of an edge where the surfaces lift off; lower ones: the number of the cell's border."""
DEPTH, SINK = 0, 1
"""Columns of `Overlaps.at`, before those of the slip and of eta."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Of pairs of facets in the second body's axes: corners a and their velocities va (P, d, d) of
    the first; planes, cells and velocities vb (P, d, d; None: at rest) of the second."""

    a: FloatArray
    va: FloatArray
    planes: Planes
    cells: Cells
    vb: FloatArray | None = None

    def some(self, chosen: IntArray) -> "Pairs":
        vb = None if self.vb is None else self.vb[chosen]
        return Pairs(self.a[chosen], self.va[chosen], self.planes.some(chosen),
                     self.cells.some(chosen), vb)

    def projected(self) -> tuple[FloatArray, FloatArray]:
        """Penetration (P, d) and eta (P, d, d: corner of the first, number) at the corners."""
        rel = self.a - self.planes.corner[:, None]
        eta = rel @ self.planes.g.transpose(0, 2, 1)
        eta[:, :, 0] += 1.0
        return np.asarray(-(rel @ self.planes.n[:, :, None])[:, :, 0]), eta

    def measure(self) -> FloatArray:
        """(P,): (d - 1)! times that of the first facet in projection on the second one, m or m2."""
        return np.asarray(-(area_vector(self.a) * self.planes.n).sum(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """Parts of first facets in contact. at (P, d, 2 + 2 d): penetration (m), its rate, slip (m/s,
    d) and eta (d) at the corners; measure (P,), m or m2, see `Pairs.measure`."""

    pairs: Pairs
    parts: Parts
    at: FloatArray
    measure: FloatArray

    @classmethod
    def of(cls, pairs: Pairs) -> tuple[Self, IntArray]:
        """The overlaps that are not empty, and which of the pairs they are of."""
        depth, eta = pairs.projected()
        borders, measure = pairs.cells.values(eta, depth), pairs.measure()
        # surfaces that look the same way are the far sides of the bodies
        some = _reaching(depth, borders, measure)
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
    def speed(self) -> FloatArray:
        """(P, 2) in the plane: slip along the second facet at the corners, m/s."""
        n = self.pairs.planes.n
        return np.asarray(self.at[:, :, 3] * n[:, :1] - self.at[:, :, 2] * n[:, 1:])


def _reaching(depth: FloatArray, borders: FloatArray, measure: FloatArray) -> IntArray:
    """Pairs that face each other of which no border of the overlap has all corners outside."""
    deepest, reach = depth[:, 0], borders[:, 0]
    for corner in range(1, depth.shape[1]):  # quicker than along rows of a few numbers
        deepest = np.maximum(deepest, depth[:, corner])
        reach = np.maximum(reach, borders[:, corner])
    ok = (deepest >= 0) & (measure > 0)
    for border in reach.T:
        ok &= border > 0
    return np.flatnonzero(ok)


def relative(pairs: Pairs, depth: FloatArray, eta: FloatArray) -> FloatArray:
    """(P, d, d) velocity w at the corners of the first facet."""
    if pairs.vb is None:
        return pairs.va
    swing = pairs.planes.g.transpose(0, 2, 1) @ (pairs.vb @ pairs.planes.n[:, :, None])
    return np.asarray(pairs.va - eta @ pairs.vb - depth[:, :, None] * swing.transpose(0, 2, 1))


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Parts of overlaps `of` (N,) on which the tractions are smooth, sorted, and the simplices that
    they are made of: piece (M,), corners (M, d, d) barycentric, size (M,): see `Parts.simplices`.
    """

    of: IntArray
    parts: Parts
    piece: IntArray
    corners: FloatArray
    size: FloatArray

    @classmethod
    def cut(cls, o: Overlaps, normal: NormalLaw, friction: FrictionLaw | None) -> Self:
        """Split where the normal law has a break and where the pressure would change its sign; in
        the plane, where the slip's speed is linear, also where the friction law has a break."""
        cuts = [(o.at[:, :, DEPTH], level) for level in normal.breaks]
        if friction is not None and o.d == 2:
            cuts += [(o.speed, level) for level in friction.breaks]
        of, parts = _signed(o, *o.parts.split(cuts), normal)
        return cls(of, parts, *parts.simplices())

    @property
    def overlap(self) -> IntArray:
        """(M,) of each simplex, sorted."""
        return self.of[self.piece]

    def samples(self, points: FloatArray) -> FloatArray:
        """(M, q, d) places of points (q, d) of each simplex."""
        return np.asarray(points @ self.corners)


def pressure(o: Overlaps, of: IntArray, s: FloatArray, normal: NormalLaw) -> FloatArray:
    """(N, q) by the law, negative where it would pull."""
    at = s @ o.at[of, :, :2]
    return normal.pressure(np.maximum(at[:, :, DEPTH], 0.0), at[:, :, SINK])[0]


def _signed(
    o: Overlaps, of: IntArray, parts: Parts, normal: NormalLaw
) -> tuple[IntArray, Parts]:
    """Pieces of one sign of the pressure. Between its roots on two edges the border is a straight
    line, and in the layer where the damping sets in nearly so."""
    p = pressure(o, of, parts.corners, normal)
    used = parts.used
    mixed = (used & (p > 0)).any(axis=1) & (used & (p < 0)).any(axis=1)
    if not mixed.any():
        return of, parts
    some, rest = np.flatnonzero(mixed), np.flatnonzero(~mixed)
    both, p = parts.some(some), p[some]
    share = _roots(o, of[some], both, p, normal)
    found = [(of[rest], parts.some(rest))]
    found += [left((of[some], both.cut(sign * p, NONE, share))) for sign in (1.0, -1.0)]
    return joined(found)


def _roots(
    o: Overlaps, of: IntArray, parts: Parts, p: FloatArray, normal: NormalLaw
) -> FloatArray:
    """(N, V) where along each edge the pressure vanishes, by bisection to round-off."""
    ends = np.take_along_axis(parts.corners, parts.following()[:, :, None], axis=1)
    low, high = np.zeros(p.shape), np.ones(p.shape)
    start: BoolArray = p >= 0
    for _ in range(52):
        middle = 0.5 * (low + high)
        s = parts.corners + middle[:, :, None] * (ends - parts.corners)
        same = (pressure(o, of, s, normal) >= 0) == start
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)
