"""Meshes with named point sets; interface of mesh plugins; mesh sizes."""

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.notes import Note
from sparsemor.core.protocols.cells import KINDS, by_kind, padded
from sparsemor.core.protocols.plugin import Plugin


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Mesh of triangles and quadrilaterals (2-D) or tetrahedra, wedges and hexahedra (3-D), with
    straight or, of second order, curved edges.

    points: (N, d) reference positions, m. cells: (E, p) point numbers of the corners in the order
    of `protocols/cells.py`, positively oriented; where kinds are mixed, rows of kinds with fewer
    corners repeat their last one. point_sets: name -> sorted point numbers. A surface (line in 2-D)
    is also a point set; its facets are the boundary facets with all corners in the set, unless the
    mesh names them. facet_sets: name -> corner numbers (F, d or 4) of the facets that a file tags,
    those inside the body included; cell_sets: name -> sorted numbers of the cells that it tags.
    midpoints: (E, m) point numbers of the further nodes of cells of second order, in the order of
    `CellKind.further`, rows filled up as those of `cells`, numbered after all corners; (E, 0) for
    first order. notes: warnings about what was read. revolved: True for the section of a body of
    revolution about y.
    """

    points: FloatArray
    cells: IntArray
    point_sets: Mapping[str, IntArray] = field(default_factory=dict)
    midpoints: IntArray = field(default_factory=lambda: np.zeros((0, 0), np.int64))
    facet_sets: Mapping[str, IntArray] = field(default_factory=dict)
    cell_sets: Mapping[str, IntArray] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    revolved: bool = False

    @property
    def dimension(self) -> int:
        return int(self.points.shape[1])

    @property
    def order(self) -> Literal[1, 2]:
        """Polynomial degree of the shape functions: 1 or 2."""
        return 2 if self.midpoints.size else 1

    @property
    def corners(self) -> FloatArray:
        """(n, d) positions of the corners, which are the first n points, m."""
        return self.points[: int(self.midpoints.min())] if self.midpoints.size else self.points

    @property
    def nodes(self) -> IntArray:
        """(E, q) point numbers of all nodes of each cell: corners, then midpoints; where kinds are
        mixed, shorter rows repeat their last number."""
        if not self.midpoints.size:
            return self.cells
        kinds = by_kind(self.cells, self.dimension)
        found: IntArray = padded([np.hstack([cells, self.midpoints[here, : len(KINDS[
            self.dimension, cells.shape[1]].further)]]) for here, cells in kinds],
            [here for here, _ in kinds])
        return found

    @property
    def parts(self) -> list[tuple[IntArray, IntArray]]:
        """Numbers (n,) and nodes (n, q), corners first, of the cells of each kind."""
        return by_kind(self.nodes, self.dimension)


@dataclass(frozen=True, slots=True)
class MeshSize:
    """Number of nodes and cells of a mesh, its dimension (2 or 3) and the order (1 or 2) of its
    elements."""

    points: int
    cells: int
    dimension: int
    order: Literal[1, 2] = 1

    def quadratic(self) -> "MeshSize":
        """Size of this mesh of linear elements with a further node on each edge: one edge for each
        corner and each cell, by Euler's formula without the boundary's share."""
        return replace(self, points=2 * self.points + self.cells, order=2)

    @property
    def pairs(self) -> int:
        """Lower bound of the number of nonzeros of a finite-element matrix with one unknown per
        node: diagonal entries and two for each pair of nodes of a cell.

        Linear elements have a pair per edge, and one edge for each corner and each cell.
        Quadratic ones have 3 pairs per edge; triangles 6 more inside; tetrahedra 6 more per face,
        of which there are two or more per cell, and 3 inside.
        """
        if self.order == 1:
            return 3 * self.points + 2 * self.cells
        edges = (self.points + self.cells) // 2
        inside = 6 if self.dimension == 2 else 15
        return self.points + 2 * (3 * edges + inside * self.cells)


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


class MeshPlugin(Plugin):
    """Options of a mesh, from which `build` makes the mesh. base: folder of the input file, for
    relative paths."""

    @abstractmethod
    def build(self, base: Path) -> Mesh: ...

    def expected(self) -> MeshSize | None:
        """Size of the mesh before it is built; None if the options do not determine it."""
        return None


OUTSIDE = 1e-2
"""Distance of a point from a body's bounding box, relative to the box's diagonal, above which there
is a warning."""


def outside_box_notes(key: str, point: Sequence[float], points: FloatArray) -> Iterator[Note]:
    """Warning if a point (d,) is outside the bounding box of points (N, d), m; key: name of the
    point in the scene."""
    at, low, high = np.asarray(point, dtype=np.float64), points.min(axis=0), points.max(axis=0)
    away = float(np.linalg.norm(at - np.clip(at, low, high)))
    size = float(np.linalg.norm(high - low))
    if away > OUTSIDE * size:
        nearest = points[np.argmin(np.linalg.norm(points - at, axis=1))]
        yield Note(f"{key} at {_point(at)} is {away:.3g} m outside its body, whose diagonal is "
                   f"{size:.3g} m: the nearest node at {_point(nearest)} is taken", "distant_point")


def _point(p: FloatArray) -> str:
    """Coordinates of a point, m, for messages."""
    return "(" + ", ".join(f"{c:.6g}" for c in p) + ")"
