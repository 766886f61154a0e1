"""Broad phase of contact: pairs of facets of two surfaces that are near each other."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.bodies.contact.surface import Surface
from sparsemor.core import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class BroadPhase:
    """Pairs of facets whose circles or balls, widened by `reach` (m), touch.

    radius: search radius, m; most: facets of the second surface that one ball can hold.
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
        """Positions in `middles` (m, d) and numbers of the tree's facets, one a pair, sorted."""
        _, found = tree.query(middles, k=np.arange(1, self.most + 1),
                              distance_upper_bound=self.radius)
        here, rank = np.nonzero(found < tree.n)
        return here, found[here, rank]
