"""Box meshed by tetrahedra."""

from itertools import permutations, product
from math import prod
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from sparsemor.core import IntArray, Mesh, MeshPlugin, MeshSize

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
SIDES = (("left", "right"), ("front", "back"), ("bottom", "top"))


class BlockMesh(MeshPlugin):
    """Block: structured mesh of 6 nx ny nz tetrahedra, six around a diagonal of each cell (Kuhn).

    Sets: left, right (x), front, back (y), bottom, top (z), and the corners left_front_bottom to
    right_back_top.
    """

    lower: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the corner with the smallest coordinates, m."""
    size: tuple[Positive, Positive, Positive]
    """Lengths along x, y and z, m."""
    divisions: tuple[Count, Count, Count]
    """Cells along x, y and z; each is split into six tetrahedra."""
    diagonal: Literal["uniform", "alternating"] = "alternating"
    """Orientation of the cells' diagonals. `uniform`: the same in all cells; `alternating`: each
    cell is the mirror image of its neighbours, which has no preferred direction."""
    refine: float = Field(default=1.0, gt=0, le=100)
    """Factor on each of the divisions, rounded."""

    def _divisions(self) -> list[int]:
        return [max(1, round(n * self.refine)) for n in self.divisions]

    def expected(self) -> MeshSize:
        n = self._divisions()
        return MeshSize(prod(k + 1 for k in n), 6 * prod(n), 3)

    def build(self, base: Path) -> Mesh:
        """The mesh; `base` is not used."""
        divisions = self._divisions()
        axes = [low + np.linspace(0.0, length, n + 1)
                for low, length, n in zip(self.lower, self.size, divisions, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=3).reshape(-1, 3)
        numbers = np.arange(len(points)).reshape([n + 1 for n in divisions])
        return Mesh(points, _kuhn(numbers, self.diagonal == "alternating"), _sets(numbers))


def _kuhn(numbers: IntArray, mirrored: bool) -> IntArray:
    """(6 cells, 4) tetrahedra of all cells, cell by cell; numbers (nx + 1, ny + 1, nz + 1): of the
    points of a grid; mirrored: cells with an odd number along an axis are mirrored along it.

    Each follows a path of edges from one corner of the cell to the opposite one, along the axes in
    some order. A mirrored cell starts at another corner, so that shared faces have the same
    diagonal.
    """
    cell = np.stack(np.meshgrid(*[np.arange(n - 1) for n in numbers.shape], indexing="ij"), axis=3)
    cell = cell.reshape(-1, 3)
    flipped = cell % 2 if mirrored else np.zeros_like(cell)
    odd_cell = flipped.sum(axis=1) % 2 == 1
    tetrahedra = []
    for order in permutations(range(3)):
        steps = np.array([np.isin(range(3), order[:i]) for i in range(4)])
        corners = [numbers[tuple((cell + (step ^ (flipped == 1))).T)] for step in steps]
        walk = np.stack(corners, axis=1)
        odd = odd_cell ^ bool(np.linalg.det(np.eye(3)[list(order)]) < 0)
        walk[odd] = walk[odd][:, [0, 1, 3, 2]]
        tetrahedra.append(walk)
    return np.stack(tetrahedra, axis=1).reshape(-1, 4)


def _sets(numbers: IntArray) -> dict[str, IntArray]:
    sets = {name: np.sort(np.take(numbers, end, axis=axis).ravel())
            for axis, names in enumerate(SIDES) for end, name in zip((0, -1), names, strict=True)}
    for corner in product(*(zip((0, -1), names, strict=True) for names in SIDES)):
        ends, names = zip(*corner, strict=True)
        sets["_".join(names)] = numbers[ends].reshape(1)
    return sets
