"""A surface of a body in space, ready for contact: triangles and the borders of their cells."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.contact.facets import Facets
from sparsemor.bodies.contact.spatial.cells import Cells, cells_of
from sparsemor.bodies.contact.spatial.planes import Planes
from sparsemor.bodies.spatial.body import SpatialBody
from sparsemor.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Surface(Facets[SpatialBody]):
    """Facets (F, 3): the normal points out of the body."""

    def _cells_of(self, chosen: IntArray) -> Mapping[str, Any]:
        return {"cells": self.cells.some(chosen)}

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
    def radii(self) -> FloatArray:
        """(F,) largest distance of each facet's points from its middle, m."""
        return radii_of(self.X[self.facets])

    @cached_property
    def radius(self) -> float:
        """Largest distance of a facet's point from its middle, m."""
        return float(self.radii.max())

    @cached_property
    def tree(self) -> Any:
        """Over the middles of the facets in the body frame."""
        return tree_of(self.X, self.facets)

    @cached_property
    def planes(self) -> Planes:
        """Of the undeformed facets, in the body frame."""
        return Planes.of(self.X[self.facets])

    @cached_property
    def cells(self) -> Cells:
        """Of the undeformed surface."""
        return cells_of(self.X, self.facets, self.planes)


def radii_of(corners: FloatArray) -> FloatArray:
    """(F,) of facets (F, 3, 3)."""
    away = corners - corners.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.norm(away, axis=2).max(axis=1))


def tree_of(z: FloatArray, facets: IntArray) -> Any:
    """Search tree over the middles of facets of points z (n, 3)."""
    return cKDTree(z[facets].mean(axis=1))
