"""A surface of a planar body, ready for contact: facets in the complex plane and their cells."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.contact.facets import Facets
from sparsemor.bodies.planar.motion import ComplexArray
from sparsemor.core.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Surface(Facets[PlanarBody]):
    """Facets (F, 2): the body is on the left of a -> b."""

    @cached_property
    def X(self) -> ComplexArray:
        """(n,) reference positions, m."""
        return np.asarray(self.body.X[self.nodes], dtype=np.complex128)

    @cached_property
    def sizes(self) -> FloatArray:
        """(F,) lengths, m."""
        return np.asarray(np.abs(np.diff(self.X[self.facets], axis=1)[:, 0]))

    @cached_property
    def radius(self) -> float:
        """Largest distance of a facet's point from its middle, m."""
        return 0.5 * float(self.sizes.max())

    @cached_property
    def tree(self) -> Any:
        """Over the middles of the facets in the body frame."""
        return tree_of(self.X, self.facets)

    @cached_property
    def turns(self) -> FloatArray:
        """(F, 2): tan(alpha / 2) at both ends of each facet, alpha the angle by which the surface
        turns there (positive: convex); 0 at an end of the surface.

        The point nearest to a place near a corner is on the facet at whose side of the angle's
        bisector the place is: the cells of all facets tile the neighbourhood of the surface.
        """
        along = np.diff(self.X[self.facets], axis=1)[:, 0]
        found = np.zeros(self.facets.shape)
        before, after = self._neighbours
        for end, other in ((0, before), (1, after)):
            has = np.flatnonzero(other >= 0)
            ratio = along[has] / along[other[has]]
            found[has, end] = np.tan(0.5 * np.angle(ratio if end == 0 else 1.0 / ratio))
        return found

    @cached_property
    def bent(self) -> BoolArray:
        """(F, 2): ends where the traction may jump, because the surface turns or ends there."""
        before, after = self._neighbours
        is_open = np.stack([before, after], axis=1) < 0
        return np.asarray(is_open | (np.abs(self.turns) > 1e-12))

    def _cells_of(self, chosen: IntArray) -> Mapping[str, Any]:
        return {"turns": self.turns[chosen], "bent": self.bent[chosen]}

    @cached_property
    def _neighbours(self) -> tuple[IntArray, IntArray]:
        """(F,) number of the facet before and after each one, -1 where there is none."""
        ends_at = np.full(len(self.nodes), -1)
        starts_at = np.full(len(self.nodes), -1)
        ends_at[self.facets[:, 1]] = starts_at[self.facets[:, 0]] = np.arange(len(self.facets))
        return ends_at[self.facets[:, 0]], starts_at[self.facets[:, 1]]


def tree_of(z: ComplexArray, facets: IntArray) -> Any:
    """Search tree over the middles of facets of points z (n,)."""
    return cKDTree(plane(z[facets].mean(axis=1)))


def plane(z: ComplexArray) -> FloatArray:
    """(..., 2) real coordinates of complex numbers (...)."""
    return np.stack([z.real, z.imag], axis=-1)
