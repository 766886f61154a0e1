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


@dataclass(frozen=True, slots=True)
class MeshSize:
    """What a mesh will have: points, cells, and its dimension (2 or 3)."""

    points: int
    cells: int
    dimension: int

    @property
    def pairs(self) -> int:
        """At least how many entries a matrix of one unknown a point has: each point with itself,
        and twice every edge. By Euler's formula, but for the edges' share of the boundary."""
        return 3 * self.points + 2 * self.cells


@dataclass(frozen=True, slots=True)
class BodySize:
    """What a flexible body will have: its mesh, and which fields on it."""

    mesh: MeshSize
    elastic: bool
    thermal: bool

    @property
    def unknowns(self) -> dict[str, int]:
        """Of each field, those that are held or given included."""
        found = {"elastic": self.mesh.dimension * self.mesh.points} if self.elastic else {}
        return found | ({"thermal": self.mesh.points} if self.thermal else {})

    @property
    def elastic_entries(self) -> int:
        """Of stiffness and thermal forces, each once."""
        d = self.mesh.dimension
        return self.mesh.pairs * (d * d + d * self.thermal) if self.elastic else 0

    @property
    def scalar_entries(self) -> int:
        """Of mass, capacity and conduction, each once."""
        return self.mesh.pairs * (1 + 2 * self.thermal)
