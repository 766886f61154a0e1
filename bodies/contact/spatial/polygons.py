"""Convex polygons inside triangles, all cut at once.

A place on a triangle is its three barycentric numbers, so what is linear on the triangle is cut
exactly: where it vanishes on an edge is the root of a linear function.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray

NONE = -1
"""Tag of an edge that bounds nothing: the triangle's own, or one between two pieces."""


@dataclass(frozen=True, slots=True, eq=False)
class Polygons:
    """places (P, V, 3) barycentric, the first `count` (P,) of each used; edges (P, V): tag of the
    edge from each corner to the next."""

    places: FloatArray
    count: IntArray
    edges: IntArray

    @classmethod
    def whole(cls, number: int) -> Self:
        """The triangles themselves."""
        places = np.broadcast_to(np.eye(3), (number, 3, 3)).copy()
        return cls(places, np.full(number, 3), np.full((number, 3), NONE))

    def some(self, chosen: IntArray | BoolArray) -> "Polygons":
        return Polygons(self.places[chosen], self.count[chosen], self.edges[chosen])

    @property
    def used(self) -> BoolArray:
        """(P, V)"""
        return np.asarray(np.arange(self.edges.shape[1]) < self.count[:, None])

    def values(self, at_corners: FloatArray) -> FloatArray:
        """(P, V) of what is linear and at_corners (P, 3) at the triangle's corners."""
        return np.asarray((self.places @ at_corners[:, :, None])[:, :, 0])

    def following(self) -> IntArray:
        """(P, V) number of the corner after each."""
        after = np.arange(1, self.edges.shape[1] + 1)[None]
        return np.where(after >= self.count[:, None], 0, after)

    def cut(self, values: FloatArray, tag: int, share: FloatArray | None = None) -> "Polygons":
        """The parts where values (P, V) at the corners are at least 0; less than three corners:
        nothing is left. share (P, V): where along each edge the value vanishes; left out: where a
        linear one does."""
        some_in, some_out = self._signs(values)
        if not some_out.any():
            return self
        rows, left = np.flatnonzero(some_in & some_out), np.where(some_in, self.count, 0)
        if not len(rows):
            return replace(self, count=left)
        at = self.some(rows)
        parts = _cut(at, values[rows], tag, None if share is None else share[rows])
        width, new = self.edges.shape[1], parts.edges.shape[1]
        grown = self if new <= width else _widened(self, new)
        places, edges = grown.places.copy(), grown.edges.copy()
        places[rows, :new], edges[rows, :new], left[rows] = parts.places, parts.edges, parts.count
        return replace(self, places=places, edges=edges, count=left)

    def _signs(self, values: FloatArray) -> tuple[BoolArray, BoolArray]:
        """(P,) which have a corner where the value is at least 0, and one where it is below."""
        some_in, some_out = np.zeros((2, len(values)), bool)
        for corner, column in enumerate(values.T):  # quicker than along rows of a few numbers
            there, inside = corner < self.count, column >= 0
            some_in |= there & inside
            some_out |= there & ~inside
        return some_in, some_out


def _cut(at: Polygons, c: FloatArray, tag: int, share: FloatArray | None) -> Polygons:
    """Of polygons that all have a corner below 0: corners kept and edges crossed, in order."""
    after, used = at.following(), at.used
    c2 = np.take_along_axis(c, after, axis=1)
    p2 = np.take_along_axis(at.places, after[:, :, None], axis=1)
    inside = c >= 0
    kept, crossed = used & inside, used & (inside != (c2 >= 0))
    if share is None:
        share = c / np.where(crossed, c - c2, 1.0)
    root = at.places + share[:, :, None] * (p2 - at.places)
    R, V = c.shape
    mask = np.stack([kept, crossed], axis=2).reshape(R, 2 * V)
    places = np.stack([at.places, root], axis=2).reshape(R, 2 * V, 3)
    tags = np.stack([at.edges, np.where(inside, tag, at.edges)], axis=2).reshape(R, 2 * V)
    rows, k = np.nonzero(mask)
    count = mask.sum(axis=1)
    to = (np.cumsum(mask, axis=1) - 1)[rows, k]
    width = max(int(count.max()), 3)
    made: Any = np.zeros((R, width, 3))
    edges = np.full((R, width), NONE)
    made[rows, to], edges[rows, to] = places[rows, k], tags[rows, k]
    return Polygons(made, np.where(count < 3, 0, count), edges)


def _widened(p: Polygons, width: int) -> Polygons:
    more = width - p.edges.shape[1]
    return Polygons(np.pad(p.places, ((0, 0), (0, more), (0, 0))), p.count,
                    np.pad(p.edges, ((0, 0), (0, more)), constant_values=NONE))


def joined(parts: list[Polygons]) -> Polygons:
    """All of them in a row."""
    width = max(p.edges.shape[1] for p in parts)
    wide = [_widened(p, width) for p in parts]
    return Polygons(np.concatenate([p.places for p in wide]),
                    np.concatenate([p.count for p in wide]),
                    np.concatenate([p.edges for p in wide]))


def fans(p: Polygons) -> tuple[IntArray, FloatArray, FloatArray]:
    """Triangles that make up the polygons: of which (N,), corners (N, 3, 3) barycentric, and size
    (N,): twice the area in the first two numbers, the triangle itself having 1."""
    V = p.edges.shape[1]
    of, k = np.nonzero(np.arange(1, V - 1) + 1 < p.count[:, None])
    corners = np.stack([p.places[of, 0], p.places[of, k + 1], p.places[of, k + 2]], axis=1)
    a, b = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    size = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return of, corners, size
