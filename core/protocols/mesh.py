"""Meshes of linear simplices with named point sets; interface of mesh plugins; mesh sizes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, runtime_checkable

from sparsemor.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Mesh of linear triangles (2-D) or tetrahedra (3-D).

    points: (N, d) reference positions, m. cells: (E, d + 1) point numbers, positively oriented.
    point_sets: name -> sorted point numbers. A surface (line in 2-D) is also a point set; its
    facets are the boundary facets with all points in the set.
    """

    points: FloatArray
    cells: IntArray
    point_sets: Mapping[str, IntArray] = field(default_factory=dict)

    @property
    def dimension(self) -> int:
        return int(self.points.shape[1])


@dataclass(frozen=True, slots=True)
class MeshSize:
    """Number of points and cells of a mesh, and its dimension (2 or 3)."""

    points: int
    cells: int
    dimension: int

    @property
    def pairs(self) -> int:
        """Lower bound of the number of nonzeros of a finite-element matrix with one unknown per
        node: diagonal entries and two per edge. It follows from Euler's formula without the
        boundary's share of the edges."""
        return 3 * self.points + 2 * self.cells


@dataclass(frozen=True, slots=True)
class BodySize:
    """Size of a flexible body before meshing.

    unknowns: number per field, including fixed and prescribed ones. vector_entries: nonzeros of
    stiffness and thermal coupling, which act on displacements; scalar_entries: nonzeros of mass,
    capacity and conductivity.
    """

    mesh: MeshSize
    unknowns: Mapping[str, int]
    vector_entries: int
    scalar_entries: int


class MeshPlugin(Protocol):
    """Options of a mesh, from which `build` makes the mesh. base: folder of the input file, for
    relative paths."""

    def build(self, base: Path) -> Mesh: ...


@runtime_checkable
class EstimatesMeshSize(Protocol):
    """A mesh plugin that reports the size of the mesh before it is built."""

    def expected(self) -> MeshSize: ...
