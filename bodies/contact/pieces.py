"""Where facets of two surfaces overlap, cut into pieces on which the tractions are smooth.

A pair of facets is z (P, 4): the ends a1, b1 of the first and a2, b2 of the second facet in the
complex plane, both with their body on the left. A place on the first facet is s in [0, 1]; seen
from the second facet it is the complex number zeta = (z - a2) / (b2 - a2), whose real part is the
projection and whose imaginary part, times the facet's length, the penetration. zeta is linear in
s, and so are the penetration, its rate and the slip: every cut is the root of a linear function,
and resultants are smooth functions of the motion although the edge of contact wanders.
"""

from dataclasses import dataclass
from typing import Self, TypeVar

import numpy as np

from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.protocols import FrictionLaw, NormalLaw

Values = TypeVar("Values", FloatArray, ComplexArray)
NONE, AT_A, AT_B, EDGE = -1, 0, 1, 2
"""What bounds an overlap: the facet's own end, a border of the second facet's cell, lift-off."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """z, rate (P, 4), m and m/s; turns (P, 2) of the second facet (see Surface)."""

    z: ComplexArray
    rate: ComplexArray
    turns: FloatArray

    def __len__(self) -> int:
        return len(self.z)

    def some(self, chosen: IntArray | BoolArray) -> "Pairs":
        return Pairs(self.z[chosen], self.rate[chosen], self.turns[chosen])

    def zeta(self) -> ComplexArray:
        """(P, 2) at both ends of the first facet."""
        base, along = self.z[:, 2:3], (self.z[:, 3] - self.z[:, 2])[:, None]
        return np.asarray((self.z[:, :2] - base) / along)


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """Parts of first facets in contact: low < high (P,) in [0, 1], cut_low, cut_high (P,) what
    bounds them. depth, sink, slip (P, 2): penetration (m), its rate and the slip of the first
    body along the second facet (m/s) at s = 0 and s = 1, between which they are linear."""

    pairs: Pairs
    low: FloatArray
    high: FloatArray
    cut_low: IntArray
    cut_high: IntArray
    depth: FloatArray
    sink: FloatArray
    slip: FloatArray

    @classmethod
    def of(cls, pairs: Pairs) -> tuple[Self, IntArray]:
        """The overlaps that are not empty, and which of the pairs they are of."""
        along = pairs.z[:, 3] - pairs.z[:, 2]
        size, zeta = np.abs(along), pairs.zeta()
        depth = size[:, None] * zeta.imag
        # surfaces that look the same way are the far sides of the bodies
        some = np.flatnonzero((depth.max(axis=1) >= 0) & (zeta[:, 1].real < zeta[:, 0].real))
        pairs, zeta, depth = pairs.some(some), zeta[some], depth[some]
        turn = pairs.turns
        bounds = np.stack([
            zeta.real - turn[:, :1] * zeta.imag, 1.0 - turn[:, 1:] * zeta.imag - zeta.real, depth])
        low, high, cut_low, cut_high = _between(bounds)
        kept = np.flatnonzero(high > low)
        pairs, zeta, depth = pairs.some(kept), zeta[kept], depth[kept]
        t = (along / size)[some][kept]
        a, b = pairs.rate[:, 2:3], (pairs.rate[:, 3] - pairs.rate[:, 2])[:, None]
        w = t.conj()[:, None] * (pairs.rate[:, :2] - a - zeta * b)
        sink = w.imag + depth * (b / along[some][kept][:, None]).real
        return cls(pairs, low[kept], high[kept], cut_low[kept], cut_high[kept], depth, sink,
                   w.real), some[kept]


def _between(f: FloatArray) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Where all of f (j, P, 2), linear from s = 0 to s = 1, are at least 0: low, high (P,) and
    which of the j bounds there; NONE: the end of [0, 1]. high <= low: nowhere."""
    f0, f1 = f[:, :, 0], f[:, :, 1]
    drop = f0 - f1
    root = f0 / np.where(drop == 0, 1.0, drop)
    starts = np.where(f0 < 0, np.where(f1 > 0, root, 2.0), 0.0)
    stops = np.where(f1 < 0, np.where(f0 > 0, root, -1.0), 1.0)
    low, high = starts.max(axis=0), stops.min(axis=0)
    cut_low = np.where(low > 0, starts.argmax(axis=0), NONE)
    cut_high = np.where(high < 1, stops.argmin(axis=0), NONE)
    return low, high, cut_low, cut_high


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """start < stop (N,) of the pieces of overlaps `of` (N,), in any order."""

    of: IntArray
    start: FloatArray
    stop: FloatArray

    @classmethod
    def cut(cls, o: Overlaps, normal: NormalLaw, friction: FrictionLaw | None) -> Self:
        """Split where a law has a break, and where the pressure would change its sign."""
        cuts = [_crossing(o.depth, level) for level in normal.breaks]
        cuts += [_crossing(o.slip, level) for level in (friction.breaks if friction else ())]
        inner = [np.clip(c, o.low, o.high) for c in cuts]
        edges = np.sort(np.stack([o.low, *inner, o.high], axis=1), axis=1)
        of, k = np.nonzero(np.diff(edges, axis=1) > 0)
        start, stop = edges[of, k], edges[of, k + 1]
        p0, p1 = (_pressure(o, of, s, normal) for s in (start, stop))
        mixed = np.flatnonzero(p0 * p1 < 0)
        if not len(mixed):
            return cls(of, start, stop)
        root = _zero(o, of[mixed], start[mixed], stop[mixed], p0[mixed] > 0, normal)
        ends = stop.copy()
        ends[mixed] = root
        return cls(np.concatenate([of, of[mixed]]), np.concatenate([start, root]),
                   np.concatenate([ends, stop[mixed]]))


def along(values: Values, of: IntArray, s: FloatArray) -> Values:
    """values (P, 2) of overlaps `of` at s, both (N,) or (N, q)."""
    v = values[of]
    if s.ndim == 2:
        return np.asarray(v[:, :1] * (1.0 - s) + v[:, 1:] * s)
    return np.asarray(v[:, 0] * (1.0 - s) + v[:, 1] * s)


def _crossing(values: FloatArray, level: float) -> FloatArray:
    """(P,) where values (P, 2) pass the level; out of [0, 1] when they do not."""
    rise = values[:, 1] - values[:, 0]
    return np.where(rise == 0, -1.0, (level - values[:, 0]) / np.where(rise == 0, 1.0, rise))


def _pressure(o: Overlaps, of: IntArray, s: FloatArray, normal: NormalLaw) -> FloatArray:
    return normal.pressure(np.maximum(along(o.depth, of, s), 0.0), along(o.sink, of, s))[0]


def _zero(
    o: Overlaps, of: IntArray, start: FloatArray, stop: FloatArray, falls: BoolArray,
    normal: NormalLaw,
) -> FloatArray:
    """Where the pressure is zero, by bisection to round-off."""
    low, high = start.copy(), stop.copy()
    for _ in range(52):
        middle = 0.5 * (low + high)
        left = (_pressure(o, of, middle, normal) > 0) == falls
        low, high = np.where(left, middle, low), np.where(left, high, middle)
    return 0.5 * (low + high)
