"""Planes of facets (segments, triangles), and gradients of barycentric coordinates."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from sparsemor.core import FloatArray, IntArray


def area_vector(a: FloatArray) -> FloatArray:
    """(F, d) outward normals of facets with corners a (F, d, d), of length (d - 1)! times the
    facet's measure.

    In the plane the body is on the left of a segment, in space corners run counter-clockwise seen
    from outside.
    """
    side = a[:, 1:] - a[:, :1]
    if a.shape[2] == 2:
        return np.stack([side[:, 0, 1], -side[:, 0, 0]], axis=1)
    return np.cross(side[:, 0], side[:, 1])


def area_slopes(a: FloatArray, n: FloatArray) -> FloatArray:
    """(F, d, d) derivative of area_vector(a) . n by each corner of facets a (F, d, d), with
    constant n (F, d)."""
    if a.shape[2] == 2:
        r = np.stack([-n[:, 1], n[:, 0]], axis=1)
        return np.stack([-r, r], axis=1)
    opposite = np.roll(a, -1, axis=1) - np.roll(a, -2, axis=1)
    return np.cross(opposite, n[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Planes of F facets: a corner (F, d), m; outward unit normal n (F, d); gradients g (F, d, d),
    1/m, of the barycentric coordinates, tangential to the facet."""

    corner: FloatArray
    n: FloatArray
    g: FloatArray

    @classmethod
    def of(cls, b: FloatArray) -> Self:
        """Planes of facets with corners b (F, d, d), m."""
        N = area_vector(b)
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
