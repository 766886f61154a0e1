"""A surface of a body, ready for contact: facets, their planes, and the cells about them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.body import Body
from sparsemor.bodies.contact.cells import Cells, cells_of
from sparsemor.bodies.contact.planes import Planes
from sparsemor.core import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Surface:
    """nodes (n,): sorted point numbers of the body; facets (F, d): positions in `nodes`, ordered
    for outward normals (fem/surface.py); cells of the undeformed facets; radius: largest distance
    of a facet's point from its middle, m, of the whole surface where these are a part of one."""

    body: Body
    nodes: IntArray
    facets: IntArray
    cells: Cells
    radius: float

    @classmethod
    def of(cls, body: Body, facets: IntArray) -> Self:
        """facets (F, d): point numbers of the body, ordered for outward normals."""
        nodes = np.unique(facets)
        at = np.searchsorted(nodes, facets)
        X = body.X[nodes]
        return cls(body, nodes, at, cells_of(X, at, Planes.of(X[at])), float(radii_of(X[at]).max()))

    def some(self, chosen: IntArray) -> tuple[Self, IntArray]:
        """Some of the facets with the cells that they have among all, and which nodes are theirs.
        """
        used = np.unique(self.facets[chosen])
        return type(self)(self.body, self.nodes[used], np.searchsorted(used, self.facets[chosen]),
                          self.cells.some(chosen), self.radius), used

    def cells_at(self, chosen: IntArray, planes: Planes) -> Cells:
        """Of some facets whose planes these are: in the plane borders keep their angle where a
        facet is stretched, in space their slope against barycentric numbers."""
        cells = self.cells.some(chosen)
        if self.d == 3:
            return cells
        g, g0 = planes.g[:, :1], self.planes.g[chosen, :1]
        stretch = np.sqrt((g * g).sum(axis=2) / (g0 * g0).sum(axis=2))
        return Cells(cells.borders, cells.leans * stretch, cells.jumps)

    @property
    def d(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.facets.shape[1])

    @cached_property
    def X(self) -> FloatArray:
        """(n, d) reference positions, m."""
        return self.body.X[self.nodes]

    @cached_property
    def sizes(self) -> FloatArray:
        """(F,) shortest edge of each facet, m."""
        corners = self.X[self.facets]
        edges = corners - np.roll(corners, -1, axis=1)
        return np.asarray(np.linalg.norm(edges, axis=2).min(axis=1))

    @cached_property
    def radii(self) -> FloatArray:
        """(F,) largest distance of each facet's points from its middle, m."""
        return radii_of(self.X[self.facets])

    @cached_property
    def tree(self) -> Any:
        """Search tree over the middles of the facets in the body frame."""
        return tree_of(self.X, self.facets)

    @cached_property
    def planes(self) -> Planes:
        """Of the undeformed facets, in the body frame."""
        return Planes.of(self.X[self.facets])


def radii_of(corners: FloatArray) -> FloatArray:
    """(F,) of facets (F, d, d)."""
    away = corners - corners.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(away, axis=2).max(axis=1))


def tree_of(z: FloatArray, facets: IntArray) -> Any:
    """Search tree over the middles of facets of points z (n, d)."""
    return cKDTree(z[facets].mean(axis=1))
