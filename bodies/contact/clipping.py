"""Clipping of facets to convex parts: intervals of segments and polygons in triangles, all facets
at once.

Points of a facet are described by their d barycentric coordinates, so linear functions on the facet
are clipped exactly: their zero on an edge is the root of a linear function.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray

NONE = -1
"""Tag of an edge that is no border of the contact: the facet's own edge, or one between two parts.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """Convex parts of P facets: intervals or polygons with up to V corners.

    corners (P, V, d): barycentric coordinates; count (P,): number of corners in use, 0 for an empty
    part; edges (P, V): tag of the edge from each corner to the next (which border cut it), in the
    plane, where V = 2, tag of the end point.
    """

    corners: FloatArray
    count: IntArray
    edges: IntArray

    @classmethod
    def whole(cls, number: int, d: int) -> Self:
        """Parts equal to `number` complete facets."""
        corners = np.broadcast_to(np.eye(d), (number, d, d)).copy()
        return cls(corners, np.full(number, d), np.full((number, d), NONE))

    @classmethod
    def within(cls, bounds: FloatArray, tags: IntArray) -> "Parts":
        """Parts of P facets on which B linear functions are nonnegative; empty ones have the count
        0.

        bounds (P, d, B): values of the functions at the facets' corners; tags (B,): tags of the
        edges that they cut.
        """
        number, d, _ = bounds.shape
        if d == 2:
            return _interval(bounds, tags)
        made: Parts = cls.whole(number, d)
        for k, tag in enumerate(tags.tolist()):
            made = made.cut(made.values(bounds[:, :, k]), tag)
        return made

    def some(self, chosen: IntArray | BoolArray) -> "Parts":
        return Parts(self.corners[chosen], self.count[chosen], self.edges[chosen])

    @property
    def used(self) -> BoolArray:
        """(P, V) boolean mask of the corners in use: polygons have different numbers of corners."""
        return np.asarray(np.arange(self.edges.shape[1]) < self.count[:, None])

    def values(self, at_corners: FloatArray) -> FloatArray:
        """(P, V) values at the parts' corners of a linear function with values at_corners (P, d) at
        the facet's corners."""
        return np.asarray((self.corners @ at_corners[:, :, None])[:, :, 0])

    def following(self) -> IntArray:
        """(P, V) number of the next corner of the polygon for each corner."""
        after = np.arange(1, self.edges.shape[1] + 1)[None]
        return np.where(after >= self.count[:, None], 0, after)

    def cut(self, values: FloatArray, tag: int, share: FloatArray | None = None) -> "Parts":
        """Clips each part to nonnegative values of a function that changes its sign at most once on
        an edge. corners (P, V, d) of parts, barycentric, of which `count` are used; 0: empty part.

        values (P, V): function at the corners; tag: of the new edges; share (P, V): position of the
        zero on each edge, from 0 to 1; by default that of a linear function.
        """
        some_in, some_out = self._signs(values)
        if not some_out.any():
            return self
        # only parts with corners of both signs are cut; those without a positive one become empty
        rows, left = np.flatnonzero(some_in & some_out), np.where(some_in, self.count, 0)
        if not len(rows):
            return replace(self, count=left)
        at, part = self.some(rows), None if share is None else share[rows]
        cut = _cut_interval if self.corners.shape[2] == 2 else _cut_polygon
        parts = cut(at, values[rows], tag, part)
        width, new = self.edges.shape[1], parts.edges.shape[1]
        grown = self if new <= width else _widened(self, new)
        corners, edges = grown.corners.copy(), grown.edges.copy()
        corners[rows, :new], edges[rows, :new], left[rows] = parts.corners, parts.edges, parts.count
        return replace(self, corners=corners, edges=edges, count=left)

    def split(self, cuts: Sequence[tuple[FloatArray, float]]) -> tuple[IntArray, "Parts"]:
        """Splits the parts along level lines of linear functions; returns the number of the
        original part of each new part, sorted, and the new parts, none empty where there are cuts.

        cuts: pairs of function values (P, d) at the facets' corners, and the level.
        """
        of = np.arange(len(self.count))
        if not cuts:
            return of, self
        if self.corners.shape[2] == 2:
            return _split_intervals(self, cuts)
        now = of, self
        for values, level in cuts:
            found = []
            for sign in (1.0, -1.0):  # below, then above the level
                at = now[1].values(sign * (level - values[now[0]]))
                found.append(nonempty((now[0], now[1].cut(at, NONE))))
            now = joined(found)
        return now

    def simplices(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Triangulation of the parts into segments or triangles: number of the part (N,),
        barycentric corners (N, d, d), and size (N,) relative to the facet. Polygons, with `count`
        of their V corners in use, are divided into triangles at their first corner."""
        if self.corners.shape[2] == 2:
            of = np.flatnonzero(self.count > 0)
            corners = self.corners[of]
            return of, corners, corners[:, 1, 1] - corners[:, 0, 1]
        V = self.edges.shape[1]
        of, k = np.nonzero(np.arange(1, V - 1) + 1 < self.count[:, None])
        corners = np.stack([self.corners[of, 0], self.corners[of, k + 1], self.corners[of, k + 2]],
                           axis=1)
        a, b = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
        return of, corners, np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])

    def _signs(self, values: FloatArray) -> tuple[BoolArray, BoolArray]:
        """(P,) True for parts with a corner where the value is at least 0, and (P,) True for parts
        with a corner where it is negative."""
        some_in, some_out = np.zeros((2, len(values)), bool)
        for corner, column in enumerate(values.T):  # quicker than along rows of a few numbers
            there, inside = corner < self.count, column >= 0
            some_in |= there & inside
            some_out |= there & ~inside
        return some_in, some_out


def nonempty(parts: tuple[IntArray, Parts]) -> tuple[IntArray, Parts]:
    """The nonempty parts, and their numbers."""
    some = np.flatnonzero(parts[1].count > 0)
    return parts[0][some], parts[1].some(some)


def joined(found: Sequence[tuple[IntArray, Parts]]) -> tuple[IntArray, Parts]:
    """All parts of several lists in one list, sorted by their numbers."""
    width = max(p.edges.shape[1] for _, p in found)
    wide = [_widened(p, width) for _, p in found]
    of = np.concatenate([f for f, _ in found])
    order = np.argsort(of, kind="stable")
    return of[order], Parts(np.concatenate([p.corners for p in wide])[order],
                            np.concatenate([p.count for p in wide])[order],
                            np.concatenate([p.edges for p in wide])[order])


def _widened(p: Parts, width: int) -> Parts:
    """Parts with arrays padded to `width` corners."""
    more = width - p.edges.shape[1]
    if not more:
        return p
    return Parts(np.pad(p.corners, ((0, 0), (0, more), (0, 0))), p.count,
                 np.pad(p.edges, ((0, 0), (0, more)), constant_values=NONE))


# ---------------------------------------------------------------------- polygons


def _cut_polygon(at: Parts, c: FloatArray, tag: int, share: FloatArray | None) -> Parts:
    """Clips R polygons, each with corners of both signs of the function c (R, V), to c >= 0
    (Sutherland and Hodgman 1974, doi 10.1145/360767.360802): retained corners and edge
    intersections, in order.

    tag: of the new edge along the cut, other edges keep theirs; share (R, V): position of the
    intersection on each edge from 0 to 1, where c is not linear (as the pressure, overlaps.py);
    None: that of a linear function.
    """
    after, used = at.following(), at.used
    c_next = np.take_along_axis(c, after, axis=1)
    next_corners = np.take_along_axis(at.corners, after[:, :, None], axis=1)
    inside = c >= 0
    kept, crossed = used & inside, used & (inside != (c_next >= 0))
    if share is None:
        share = c / np.where(crossed, c - c_next, 1.0)
    intersections = at.corners + share[:, :, None] * (next_corners - at.corners)
    R, V = c.shape
    # candidates in order: each corner, then the intersection on the edge that begins there; the
    # edge from an intersection at which the polygon leaves c >= 0 is the new one
    mask = np.stack([kept, crossed], axis=2).reshape(R, 2 * V)
    corners = np.stack([at.corners, intersections], axis=2).reshape(R, 2 * V, 3)
    tags = np.stack([at.edges, np.where(inside, tag, at.edges)], axis=2).reshape(R, 2 * V)
    rows, k = np.nonzero(mask)
    count = mask.sum(axis=1)
    place = (np.cumsum(mask, axis=1) - 1)[rows, k]  # among the retained candidates
    width = max(int(count.max()), 3)
    packed = np.zeros((R, width, 3))
    edges = np.full((R, width), NONE)
    packed[rows, place], edges[rows, place] = corners[rows, k], tags[rows, k]
    return Parts(packed, np.where(count < 3, 0, count), edges)


# ---------------------------------------------------------------------- intervals


def _at(s: FloatArray) -> FloatArray:
    """(..., 2) barycentric coordinates (1 - s, s) of points at coordinate s (...) from 0 to 1 on a
    segment."""
    made = np.empty((*s.shape, 2))
    np.subtract(1.0, s, out=made[..., 0])
    made[..., 1] = s
    return made


def _two(first: Any, second: Any) -> Any:
    """(P, 2) array of two columns (P,); four times as fast as np.stack, and called often."""
    made = np.empty((len(first), 2), first.dtype)
    made[:, 0], made[:, 1] = first, second
    return made


def _interval(bounds: FloatArray, tags: IntArray) -> Parts:
    """Parts of P segments on which B linear functions are nonnegative: from the last of the points
    where a function becomes positive to the first where one becomes negative. bounds (P, 2, B):
    values at both ends; tags (B,): tag of an end that the function cuts, while an uncut end has
    `NONE`; `_at`: barycentric coordinates (1 - t, t) of positions t from 0 to 1."""
    f0, f1 = bounds[:, 0], bounds[:, 1]
    drop = f0 - f1
    root = f0 / np.where(drop == 0, 1.0, drop)
    # beyond the segment, at 2 or -1, where a function is negative throughout: an empty interval
    starts = np.where(f0 < 0, np.where(f1 > 0, root, 2.0), 0.0)
    stops = np.where(f1 < 0, np.where(f0 > 0, root, -1.0), 1.0)
    low, high = starts.max(axis=1), stops.min(axis=1)
    edges = _two(np.where(low > 0, tags[starts.argmax(axis=1)], NONE),
                 np.where(high < 1, tags[stops.argmin(axis=1)], NONE))
    return Parts(_at(_two(low, high)), np.where(high > low, 2, 0), edges)


def _cut_interval(at: Parts, c: FloatArray, tag: int, share: FloatArray | None) -> Parts:
    """Clips intervals with function values c (R, 2) of both signs at their ends to c >= 0; tag,
    share: as in `_cut_polygon`."""
    rows, out = np.arange(len(c)), np.where(c[:, 0] < 0, 0, 1)  # the end that is cut off
    t = c[:, 0] / (c[:, 0] - c[:, 1]) if share is None else share[:, 0]
    corners, edges = at.corners.copy(), at.edges.copy()
    corners[rows, out] = at.corners[:, 0] + t[:, None] * (at.corners[:, 1] - at.corners[:, 0])
    edges[rows, out] = tag
    return Parts(corners, np.where(corners[:, 0, 1] < corners[:, 1, 1], 2, 0), edges)


def _split_intervals(
    p: Parts, cuts: Sequence[tuple[FloatArray, float]]
) -> tuple[IntArray, Parts]:
    """`Parts.split` for segments: at the coordinates from 0 to 1 where each function, values (P, 2)
    at the ends, has its level, if that is inside a part. of: part of each new one; edges: tags of
    its two ends, `NONE` at a cut; corners are barycentric (1 - t, t), low and high are t."""
    low, high = p.corners[:, 0, 1], p.corners[:, 1, 1]
    inner = [np.clip(_crossing(values, level), low, high) for values, level in cuts]
    ends = np.sort(np.stack([low, *inner, high], axis=1), axis=1)
    of, k = np.nonzero((np.diff(ends, axis=1) > 0) & (p.count > 0)[:, None])
    start, stop = ends[of, k], ends[of, k + 1]
    edges = _two(np.where(start == low[of], p.edges[of, 0], NONE),
                 np.where(stop == high[of], p.edges[of, 1], NONE))
    return of, Parts(_at(_two(start, stop)), np.full(len(of), 2), edges)


def _crossing(values: FloatArray, level: float) -> FloatArray:
    """(P,) coordinate from 0 to 1 at which a linear function with end values (P, 2) attains the
    level; -1 where the function is constant."""
    rise = values[:, 1] - values[:, 0]
    return np.where(rise == 0, -1.0, (level - values[:, 0]) / np.where(rise == 0, 1.0, rise))
