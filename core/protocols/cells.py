"""Kinds of cells of first and second order: triangles and quadrilaterals (2-D), tetrahedra, wedges
and hexahedra (3-D).

Corners are numbered as in VTK, those of a wedge as in Gmsh. A cell of second order has further
nodes: on each edge, then, in space, on each facet with four corners, then inside quadrilaterals and
hexahedra (6, 9, 10, 18 and 27 nodes in all). Where a mesh mixes kinds, shorter rows repeat their
last number up to the length of the longest; so do facets of three corners next to those of four.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class CellKind:
    """Kind of cells. names: of first and second order in meshio. places (p, d): corners of the
    reference cell; facets: corners, ordered for outward normals; edges: both corners; turns: at
    each corner (of a simplex, at the first) itself and its neighbours in positive orientation;
    filled: True with a node inside."""

    names: tuple[str, str]
    places: tuple[tuple[float, ...], ...]
    facets: tuple[tuple[int, ...], ...]
    edges: tuple[tuple[int, int], ...]
    turns: tuple[tuple[int, ...], ...]
    filled: bool = False

    @cached_property
    def further(self) -> tuple[tuple[int, ...], ...]:
        """Corners between which each further node of second order lies."""
        quads = tuple(f for f in self.facets if len(f) == 4)
        return self.edges + quads + ((tuple(range(len(self.places))),) if self.filled else ())

    @cached_property
    def nodes(self) -> FloatArray:
        """(q, d) nodes of the reference cell of second order."""
        corners = np.array(self.places)
        return np.array([*self.places, *(corners[list(f)].mean(axis=0) for f in self.further)])


_SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
_TRIANGLE = _SQUARE[:2] + _SQUARE[3:]
KINDS: Mapping[tuple[int, int], CellKind] = {
    (2, 3): CellKind(("triangle", "triangle6"), _TRIANGLE, ((0, 1), (1, 2), (2, 0)),
                     ((0, 1), (1, 2), (0, 2)), ((0, 1, 2),)),
    (2, 4): CellKind(("quad", "quad9"), _SQUARE, ((0, 1), (1, 2), (2, 3), (3, 0)),
                     ((0, 1), (1, 2), (2, 3), (3, 0)),
                     ((0, 1, 3), (1, 2, 0), (2, 3, 1), (3, 0, 2)), True),
    (3, 4): CellKind(("tetra", "tetra10"), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0),
                                            (0.0, 0.0, 1.0)),
                     ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
                     ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)), ((0, 1, 2, 3),)),
    (3, 6): CellKind(("wedge", "wedge18"), tuple((*x, z) for z in (0.0, 1.0) for x in _TRIANGLE),
                     ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
                     ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
                     ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5), (3, 5, 4, 0), (4, 3, 5, 1),
                      (5, 4, 3, 2))),
    (3, 8): CellKind(("hexahedron", "hexahedron27"),
                     tuple((*x, z) for z in (0.0, 1.0) for x in _SQUARE),
                     ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1),
                      (4, 5, 6, 7)),
                     ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4),
                      (1, 5), (2, 6), (3, 7)),
                     ((0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7), (4, 7, 5, 0),
                      (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3)), True)}
"""Kinds by dimension and number of corners."""
_CORNERS = {(d, nodes): corners for (d, corners), kind in KINDS.items()
            for nodes in (corners, corners + len(kind.further))}


def corners_of(d: int, nodes: int) -> int:
    """Number of corners of a cell of this dimension with so many nodes."""
    return _CORNERS[d, nodes]


def by_kind(cells: IntArray, d: int) -> list[tuple[IntArray, IntArray]]:
    """Numbers (n,) and nodes (n, q) of the cells of each kind among rows (E, ...) of corners, or of
    corners and further nodes."""
    if cells.shape[1] == d + 1 or not len(cells):
        return [(np.arange(len(cells)), cells)]
    count = 1 + np.count_nonzero(cells != cells[:, -1:], axis=1)
    return [(here, cells[here, :q]) for q in np.unique(count).tolist()
            for here in [np.flatnonzero(count == q)]]


def padded(rows: Sequence[NDArray[Any]], numbers: Sequence[IntArray]) -> Any:
    """(E, m) rows of several lengths, (n, k) each with the numbers (n,), as one array: shorter ones
    repeat their last number."""
    if len(rows) == 1:
        return rows[0]
    found = np.zeros((sum(map(len, numbers)), max(r.shape[1] for r in rows)), rows[0].dtype)
    for here, own in zip(numbers, rows, strict=True):
        found[here] = own[:, np.minimum(np.arange(found.shape[1]), own.shape[1] - 1)]
    return found
