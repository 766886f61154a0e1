"""Rectangle meshed by right triangles."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from sparsemor.bodies.mesh.generators.quads import checkerboard, grid_quads, split_quads
from sparsemor.core import BoolArray, IntArray, Mesh, MeshPlugin, MeshSize

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
