"""Rectangle meshed by right triangles; structured blocks of quadrilaterals, and their subdivision
into triangles."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from sparsemor.core import BoolArray, FloatArray, IntArray, Mesh, MeshPlugin, MeshSize


def grid_quads(numbers: IntArray) -> IntArray:
    """Corners (Q, 4) of the quads of a grid of point numbers (I + 1, J + 1), row by row.

    The corners run (i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1): counter-clockwise when i, j
    point along right-handed directions.
    """
    corners = (numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:])
    return np.stack([c.ravel() for c in corners], axis=1)


def split_quads(quads: IntArray, main: BoolArray) -> IntArray:
    """Triangles (2 Q, 3), two per quad: split along corners 0-2 where `main` (Q,), else along 1-3.
    """
    along_02 = quads[:, [0, 1, 2, 0, 2, 3]]
    along_13 = quads[:, [0, 1, 3, 1, 2, 3]]
    return np.where(main[:, None], along_02, along_13).reshape(-1, 3)


def shorter_diagonal(points: FloatArray, quads: IntArray, ties: BoolArray) -> BoolArray:
    """(Q,) True where diagonal 0-2 is the shorter one; `ties` (Q,) decides equal lengths.

    Lengths within 1e-9 of each other are equal, so that round-off has no influence.
    """
    first = np.linalg.norm(points[quads[:, 0]] - points[quads[:, 2]], axis=1)
    second = np.linalg.norm(points[quads[:, 1]] - points[quads[:, 3]], axis=1)
    equal = np.abs(first - second) <= 1e-9 * (first + second)
    return np.where(equal, ties, first < second)


def checkerboard(columns: int, rows: int) -> BoolArray:
    """(columns * rows,) True for quads with even i + j, in the order of `grid_quads`."""
    i, j = np.indices((columns, rows))
    return np.asarray((i + j) % 2 == 0).ravel()


Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]


class Rectangle(MeshPlugin):
    """Rectangle: structured mesh of 2 nx ny triangles.

    Sets: left, right, bottom, top, and the corners bottom_left, bottom_right, top_left, top_right.
    """

    lower: tuple[float, float] = (0.0, 0.0)
    """Position of the lower left corner, m."""
    size: tuple[Positive, Positive]
    """Width and height, m."""
    divisions: tuple[Count, Count]
    """Number of quads along x and along y; each is split into two triangles."""
    diagonal: Literal["uniform", "alternating"] = "uniform"
    """Diagonals of the quads. `uniform`: from lower left to upper right in all quads;
    `alternating`: as on a checkerboard, which has no preferred direction."""

    def expected(self) -> MeshSize:
        nx, ny = self.divisions
        return MeshSize((nx + 1) * (ny + 1), 2 * nx * ny, 2)

    def build(self, base: Path) -> Mesh:
        """The mesh; `base` is not used."""
        nx, ny = self.divisions
        x = self.lower[0] + np.linspace(0.0, self.size[0], nx + 1)
        y = self.lower[1] + np.linspace(0.0, self.size[1], ny + 1)
        points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2).reshape(-1, 2)
        numbers = np.arange(points.shape[0]).reshape(nx + 1, ny + 1)
        return Mesh(points, split_quads(grid_quads(numbers), self._main()), _sets(numbers))

    def _main(self) -> BoolArray:
        nx, ny = self.divisions
        return checkerboard(nx, ny) if self.diagonal == "alternating" else np.ones(nx * ny, bool)


def _sets(numbers: IntArray) -> dict[str, IntArray]:
    sets = {
        "left": numbers[0], "right": numbers[-1], "bottom": numbers[:, 0], "top": numbers[:, -1],
        "bottom_left": numbers[:1, 0], "bottom_right": numbers[-1:, 0],
        "top_left": numbers[:1, -1], "top_right": numbers[-1:, -1],
    }
    return {name: np.sort(members) for name, members in sets.items()}
