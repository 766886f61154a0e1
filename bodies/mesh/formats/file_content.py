"""Content of a mesh file, as all readers return it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sparsemor.core import FloatArray, InputError, IntArray, Note

CELLS = {
    "vertex": (0, 1, 1), "line": (1, 2, 2), "line3": (1, 2, 3),
    "triangle": (2, 3, 3), "triangle6": (2, 3, 6), "triangle7": (2, 3, 7),
    "quad": (2, 4, 4), "quad8": (2, 4, 8), "quad9": (2, 4, 9),
    "tetra": (3, 4, 4), "tetra10": (3, 4, 10), "wedge": (3, 6, 6), "wedge15": (3, 6, 15),
    "wedge18": (3, 6, 18), "hexahedron": (3, 8, 8), "hexahedron20": (3, 8, 20),
    "hexahedron24": (3, 8, 24), "hexahedron27": (3, 8, 27)}
"""Dimension, and numbers of corners and nodes, of the cells that a body is made of, by their names
in meshio: corners, then nodes of the edges, in the order of `CellKind.edges`, then others, which
are not read."""
INTEGER = re.compile(r"[+-]?\d{1,18}", re.ASCII)
"""A whole number that fits in 64 bits."""
_DIMENSION = (("vertex", 0), ("line", 1), ("triangle", 2), ("quad", 2), ("polygon", 2),
              ("tetra", 3), ("hexahedron", 3), ("wedge", 3), ("pyramid", 3), ("polyhedron", 3))


def dimension_of(kind: str) -> int:
    """Dimension (0 to 3) of a type of cells, by its name in meshio; ValueError for others."""
    for start, d in _DIMENSION:
        if kind.startswith(start):
            return d
    raise ValueError(f"cells of type {kind}")


@dataclass(frozen=True, slots=True, eq=False)
class CellBlock:
    """Cells of one type: nodes (m, p), point numbers, corners first, then midpoints in the order
    of `CellKind.edges`; place: line and keyword of the file, if known, such as `:67: *ELEMENT`."""

    kind: str
    nodes: IntArray
    place: str = ""

    @property
    def dimension(self) -> int:
        return dimension_of(self.kind)


@dataclass(slots=True, eq=False)
class MeshGroup:
    """Named set of a file, collected piece by piece.

    points: point numbers that the file lists; facets: corner numbers (F, d) of facets that it
    lists; cells: (number of the block, rows in it) of cells of any dimension that it tags.
    """

    points: list[IntArray] = field(default_factory=list)
    facets: list[IntArray] = field(default_factory=list)
    cells: list[tuple[int, IntArray]] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """Content of a mesh file: points (n, 2 or 3); blocks of cells, none empty; groups by name;
    warnings of the reader."""

    points: FloatArray
    blocks: Sequence[CellBlock]
    groups: Mapping[str, MeshGroup]
    notes: tuple[Note, ...] = ()

    def counts(self) -> dict[str, int]:
        """Number of cells of each type, and `type in name` of the tagged cells of each group."""
        found: dict[str, int] = {}
        for block in self.blocks:
            found[block.kind] = found.get(block.kind, 0) + len(block.nodes)
        for name, group in self.groups.items():
            for b in {b for b, _ in group.cells}:
                rows = np.concatenate([rows for other, rows in group.cells if other == b])
                key = f"{self.blocks[b].kind} in {name!r}"
                found[key] = found.get(key, 0) + len(np.unique(rows))
        return found


class BadLine(InputError):
    """Fault in a line of a mesh file."""

    def __init__(self, line: int, keyword: str, message: str) -> None:
        super().__init__(f":{line}: {keyword}: {message}", "path")


def decoded(data: bytes) -> list[str]:
    """Lines of a text file: UTF-8, or Latin-1 where it is not."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


COMPLETE = " (Gmsh: set Mesh.SecondOrderIncomplete = 1 for this format)"
"""What to do about cells with nodes inside their faces, in formats that have none."""


class Numbering:
    """Positions of labels, such as the numbers of nodes in a file: label -> its row among labels
    (n,), which are distinct (`repeated` tells one that is not). order: rows by ascending labels."""

    def __init__(self, labels: IntArray) -> None:
        self.order = np.argsort(labels, kind="stable")
        self.sorted = labels[self.order]

    def repeated(self) -> int | None:
        """A label that occurs twice, if any."""
        same = np.flatnonzero(self.sorted[1:] == self.sorted[:-1])
        return int(self.sorted[same[0]]) if same.size else None

    def rows(self, labels: IntArray) -> IntArray:
        """Rows of labels of any shape; -1 for one that does not exist."""
        if not len(self.sorted):
            return np.full(labels.shape, -1, dtype=np.int64)
        at = np.minimum(np.searchsorted(self.sorted, labels), len(self.sorted) - 1)
        return np.where(self.sorted[at] == labels, self.order[at], -1).astype(np.int64)

    def between(self, first: int, last: int, step: int) -> IntArray:
        """Labels first, first + step, ... up to last that exist, however long that range is."""
        found = self.sorted[np.searchsorted(self.sorted, first):
                            np.searchsorted(self.sorted, last, side="right")]
        return np.asarray(found[(found - first) % step == 0])
