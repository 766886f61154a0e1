"""A surface of a body in space, ready for contact: triangles and the borders of their cells."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.spatial.body import SpatialBody
from sparsemor.core.arrays import BoolArray, FloatArray, IntArray

FLAT = 1e-9
"""Angle (rad) between neighbours below which they count as one plane: rounding of a mesh file."""


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Of facets b (F, 3, 3): a corner (F, 3), the outward unit normal n (F, 3), and the gradients
    of the three corners' linear functions g (F, 3, 3), 1/m, which lie in the facet's plane."""

    corner: FloatArray
    n: FloatArray
    g: FloatArray

    @classmethod
    def of(cls, b: FloatArray) -> Self:
        p, q = b[:, 1] - b[:, 0], b[:, 2] - b[:, 0]
        N = np.cross(p, q)
        size = (N * N).sum(axis=1, keepdims=True)
        g1, g2 = np.cross(q, N) / size, np.cross(N, p) / size
        return cls(b[:, 0], N / np.sqrt(size), np.stack([-g1 - g2, g1, g2], axis=1))

    def some(self, chosen: IntArray) -> "Planes":
        return Planes(self.corner[chosen], self.n[chosen], self.g[chosen])


@dataclass(frozen=True, eq=False)
class Surface:
    """nodes (n,): sorted point numbers of the body; facets (F, 3): positions in `nodes`, ordered
    so that the normal points out of the body."""

    body: SpatialBody
    nodes: IntArray
    facets: IntArray

    @classmethod
    def of(cls, body: SpatialBody, facets: IntArray) -> Self:
        """facets (F, 3): point numbers, outward ordered (fe/surface.py)."""
        nodes = np.unique(facets)
        return cls(body, nodes, np.searchsorted(nodes, facets))

    @cached_property
    def X(self) -> FloatArray:
        """(n, 3) reference positions, m."""
        return np.asarray(self.body.X[self.nodes], dtype=np.float64)

    @cached_property
    def sizes(self) -> FloatArray:
        """(F,) shortest edge of each facet, m."""
        corners = self.X[self.facets]
        edges = corners - np.roll(corners, -1, axis=1)
        return np.asarray(np.linalg.norm(edges, axis=2).min(axis=1))

    @cached_property
    def radius(self) -> float:
        """Largest distance of a facet's point from its middle, m."""
        corners = self.X[self.facets]
        middles = corners.mean(axis=1, keepdims=True)
        return float(np.linalg.norm(corners - middles, axis=2).max())

    @cached_property
    def tree(self) -> Any:
        """Over the middles of the facets in the body frame."""
        return tree_of(self.X, self.facets)

    @cached_property
    def planes(self) -> Planes:
        """Of the undeformed facets, in the body frame."""
        return Planes.of(self.X[self.facets])

    @cached_property
    def turns(self) -> FloatArray:
        """(F, 3), 1/m: tan(alpha / 2) |g| at the edge opposite each corner, alpha the angle by
        which the surface turns there (positive: convex); 0 at an end of the surface.

        The place nearest to a point near an edge is on the facet at whose side of the plane that
        halves the edge's angle the point is: the cells of two neighbours share that plane.
        """
        other, planes = self._neighbours, self.planes
        facet, edge = np.nonzero(other >= 0)
        far = other[facet, edge]
        n, m = planes.n[facet], planes.n[far]
        step = self.X[self.facets[far]].mean(axis=1) - self.X[self.facets[facet]].mean(axis=1)
        bend = np.linalg.norm(np.cross(n, m), axis=1) / (1.0 + (n * m).sum(axis=1))
        found = np.zeros(self.facets.shape)
        found[facet, edge] = np.where(bend < FLAT, 0.0, np.sign(-(n * step).sum(axis=1)) * bend
                                      ) * np.linalg.norm(planes.g[facet, edge], axis=1)
        return found

    @cached_property
    def bent(self) -> BoolArray:
        """(F, 3): edges where the traction may jump, because the surface turns or ends there, or
        turns at one of the facet's corners: cells that meet in a point need not tile."""
        turned = self.turns != 0
        corners = np.zeros(len(self.nodes), bool)
        for end in (1, 2):
            corners[np.roll(self.facets, -end, axis=1)[turned]] = True
        near = corners[self.facets].any(axis=1, keepdims=True)
        return np.asarray((self._neighbours < 0) | near)

    @cached_property
    def _neighbours(self) -> IntArray:
        """(F, 3) number of the facet across the edge opposite each corner, -1: there is none."""
        start, stop = np.roll(self.facets, -1, axis=1), np.roll(self.facets, -2, axis=1)
        n = len(self.nodes)
        there, back = (start * n + stop).ravel(), (stop * n + start).ravel()
        order = np.argsort(there)
        at = np.minimum(np.searchsorted(there, back, sorter=order), len(order) - 1)
        found = order[at]
        return np.where(there[found] == back, found // 3, -1).reshape(self.facets.shape)


def tree_of(z: FloatArray, facets: IntArray) -> Any:
    """Search tree over the middles of facets of points z (n, 3)."""
    return cKDTree(z[facets].mean(axis=1))
