"""Contact surface of a body: its facets, their planes, and the regions of space nearest to each
facet."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.body import FloatingBody
from sparsemor.bodies.contact.cells import FacetCells, cells_of
from sparsemor.bodies.contact.planes import Planes
from sparsemor.core import FloatArray, IntArray


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
    def of(cls, body: FloatingBody, facets: IntArray) -> Self:
        """Surface of facets (F, d), node numbers of the body, ordered for outward normals."""
        nodes = np.unique(facets)
        at = np.searchsorted(nodes, facets)
        X = body.X[nodes]
        return cls(body, nodes, at, cells_of(X, at, Planes.of(X[at])), float(radii_of(X[at]).max()))

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
        space they keep their slope in barycentric coordinates.
        """
        cells = self.cells.some(chosen)
        if self.d == 3:
            return cells
        g, g0 = planes.g[:, :1], self.planes.g[chosen, :1]
        stretch = np.sqrt((g * g).sum(axis=2) / (g0 * g0).sum(axis=2))
        return FacetCells(cells.borders, cells.leans * stretch, cells.jumps)

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
        return Planes.of(self.X[self.facets])


def radii_of(corners: FloatArray) -> FloatArray:
    """(F,) largest distance of a corner from the centroid, m, of facets with corners (F, d, d)."""
    away = corners - corners.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(away, axis=2).max(axis=1))


def tree_of(z: FloatArray, facets: IntArray) -> Any:
    """Search tree over the centroids of facets (F, d), whose nodes are at z (n, d), m."""
    return cKDTree(z[facets].mean(axis=1))
