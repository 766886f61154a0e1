"""Broad phase of contact: search for pairs of close facets of two surfaces."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.contact.surface import Surface
from sparsemor.core import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class BroadPhase:
    """Search for facet pairs whose bounding circles or spheres, enlarged by a length `reach` (m),
    intersect.

    radius: search radius between centroids, m; most: largest number of facets of the second surface
    within the radius of any point.
    """

    radius: float
    most: int

    @classmethod
    def of(cls, first: Surface, second: Surface, reach: float) -> "BroadPhase":
        radius = first.radius + second.radius + reach
        # a ball that holds one middle at all lies in the ball of twice the radius about it
        held = second.tree.query_ball_point(second.tree.data, 2.0 * radius, return_length=True)
        return cls(radius, int(held.max()))

    def pairs(self, middles: FloatArray, tree: Any) -> tuple[IntArray, IntArray]:
        """Pairs of close facets, sorted: positions in `middles` (m, d), the centroids of first
        facets, m, and facet numbers in `tree`, the search tree of the second surface."""
        _, found = tree.query(middles, k=np.arange(1, self.most + 1),
                              distance_upper_bound=self.radius)
        here, rank = np.nonzero(found < tree.n)
        return here, found[here, rank]
