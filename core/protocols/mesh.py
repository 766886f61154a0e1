"""Meshes: points, simplices and named sets; the plugin that makes one, and its counts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

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
    """Size of a mesh: points, cells, and its dimension (2 or 3)."""

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
    """Size of a flexible body before it is meshed.

    unknowns: of each field by name, those that are held or given included. vector_entries: of
    matrices that act on displacements, each once; scalar_entries: of mass, capacity and conduction,
    each once.
    """

    mesh: MeshSize
    unknowns: Mapping[str, int]
    vector_entries: int
    scalar_entries: int


class MeshPlugin(Protocol):
    """A mesh of a body. base: folder of the scene file, for relative paths."""

    def build(self, base: Path) -> Mesh: ...


@runtime_checkable
class EstimatesMeshSize(Protocol):
    """A mesh plugin with known counts, before it is built."""

    def expected(self) -> MeshSize: ...
