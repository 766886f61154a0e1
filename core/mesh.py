"""A mesh as bodies hand it around: points, simplices and named sets."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from sparsemor.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Linear simplices.

    points: (N, d) reference positions, m. cells: (E, d + 1) point numbers, positively oriented.
    point_sets: name -> sorted point numbers. A surface (line in 2-D) is a point set too: its
    facets are the boundary facets whose points all belong to it.
    """

    points: FloatArray
    cells: IntArray
    point_sets: Mapping[str, IntArray] = field(default_factory=dict)

    @property
    def dimension(self) -> int:
        return int(self.points.shape[1])
