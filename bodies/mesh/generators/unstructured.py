"""Rectangle meshed by a prescribed number of unstructured triangles."""

from functools import lru_cache
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator
from scipy.spatial import Delaunay, QhullError

from sparsemor.bodies.mesh.cell_measures import signed_measures
from sparsemor.core import FloatArray, InputError, IntArray, Mesh, MeshPlugin, MeshSize

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]

LEAST_QUALITY = 0.6
"""Smallest admissible quality 4 sqrt(3) A / (sum of squared edges) of a triangle, 1 for an
equilateral one."""
SWEEPS = 40
STARTS = 4
_NOTHING = np.zeros((0, 2)), np.zeros((0, 3), np.int64)


class Unstructured(MeshPlugin):
    """Unstructured rectangle: triangles of similar size that are not aligned with the sides.

    A triangulation of N points, B of them on the outline, has 2 N - 2 - B triangles, so the number
    of interior points follows from `divisions` and `elements`. They start at random positions and
    are moved by optimal Delaunay smoothing (Chen & Holst 2011, doi 10.1016/j.cma.2010.11.007). The
    same options give the same mesh. Sets: left, right, bottom, top, the corners bottom_left,
    bottom_right, top_left, top_right, and top_center where a node is in the middle of the top.
    """

    lower: tuple[float, float] = (0.0, 0.0)
    """Position of the lower left corner, m."""
    size: tuple[Positive, Positive]
    """Width and height, m."""
    divisions: tuple[Count, Count]
    """Number of segments along the bottom and top, and along the left and right side."""
    elements: Count
    """Number of triangles before refinement, exactly: even, at least 2 (nx + ny) - 2."""
    refine: int = Field(default=0, ge=0, le=6)
    """Number of refinements, each of which splits every triangle into four."""
    seed: int = Field(default=0, ge=0)
    """Seed of the random initial positions: another seed gives another mesh with as many triangles.
    """

    @model_validator(mode="after")
    def _countable(self) -> "Unstructured":
        """Checks that so many triangles fit the B points of the outline: 2 N - 2 - B of them with N
        points in all, so at least B - 2, and, as B is even, an even number."""
        edge = self._outline_points
        if self.elements < edge - 2:
            raise InputError(
                f"{self.elements} triangles cannot be made: the outline of {edge} segments alone "
                f"needs {edge - 2}; give more elements or fewer divisions")
        if self.elements % 2:
            raise InputError(
                f"{self.elements} triangles cannot be made: as each side has as many segments as "
                f"the one across, their number is even; take {self.elements + 1}")
        return self

    @property
    def _outline_points(self) -> int:
        return 2 * sum(self.divisions)

    def expected(self) -> MeshSize:
        cells, outline = self.elements * 4**self.refine, self._outline_points * 2**self.refine
        return MeshSize((cells + 2 + outline) // 2, cells, 2)

    def build(self, base: Path) -> Mesh:
        """The mesh; `base` is not used. InputError (key `elements`) if the size of the triangles
        does not match the segments on the outline, so that some would be flat."""
        points, cells = _searched(self) if self._may_fit() else _NOTHING
        if not len(cells) or quality(points, cells).min() < LEAST_QUALITY:
            raise InputError(self._misfit(), "elements")
        if self.refine:
            points, cells = _refined(points, cells, self.refine)
        return Mesh(points + np.array(self.lower), cells.copy(), self._sets(points))

    def _may_fit(self) -> bool:
        """False where the triangles are much smaller or larger than the segments of the outline, to
        skip the computation."""
        segments = [length / n for length, n in zip(self.size, self.divisions, strict=True)]
        return 0.5 * max(segments) < self._side < 4.0 * min(segments)

    @property
    def _side(self) -> float:
        """Side length of the triangles if all were equilateral, m."""
        return float(np.sqrt(4.0 * np.prod(self.size) / (np.sqrt(3.0) * self.elements)))

    def _best(self) -> tuple[FloatArray, IntArray]:
        """Triangulation with the best worst quality of all smoothing iterations: from `STARTS`
        random positions of the interior points at most, `SWEEPS` times each, until one is good
        enough. Empty arrays if none has the wanted number of triangles."""
        outline = _outline(self.size, self.divisions)
        inside = (self.elements + 2 + len(outline)) // 2 - len(outline)
        margin = 0.15 * self._side  # a point nearer to a side would make it a flat triangle
        low, high = np.full(2, margin), np.array(self.size) - margin
        rng = np.random.default_rng(self.seed)
        (points, cells), best = _NOTHING, 0.0
        for _ in range(STARTS):
            moving = low + (high - low) * rng.random((inside, 2))
            for _ in range(SWEEPS):
                tried = np.concatenate([outline, moving])
                found = _triangulate(tried, 1e-6 * self._side**2)
                if len(found) != self.elements:  # round-off: three points on a line, start again
                    break
                worst = float(quality(tried, found).min())
                if worst > best:
                    points, cells, best = tried, found, worst
                moving = np.clip(_smoothed(tried, found)[len(outline):], low, high)
            if best >= LEAST_QUALITY:
                break
        return points, cells

    def _misfit(self) -> str:
        """Message for a number of triangles that does not go with the divisions of the outline."""
        area, segment = self.size[0] * self.size[1], sum(self.size) / sum(self.divisions)
        fitting = 2 * round(2.0 * area / (np.sqrt(3.0) * segment**2))
        return (f"{self.elements} triangles have sides of {self._side:.3g} m, which does not go "
                f"with segments of {self.size[0] / self.divisions[0]:.3g} m along x and "
                f"{self.size[1] / self.divisions[1]:.3g} m along y: some would be flat (quality "
                f"below {LEAST_QUALITY}); these divisions take about {fitting} triangles")

    def _sets(self, points: FloatArray) -> dict[str, IntArray]:
        """Sets of points: sides, corners, and the middle of the top if a point is there."""
        x, y = points.T
        near = 1e-9 * max(self.size)
        sides = {"left": x < near, "right": x > self.size[0] - near,
                 "bottom": y < near, "top": y > self.size[1] - near}
        corners = {f"{v}_{h}": sides[v] & sides[h]
                   for v in ("bottom", "top") for h in ("left", "right")}
        middle = {"top_center": sides["top"] & (np.abs(x - self.size[0] / 2) < near)}
        return {name: np.flatnonzero(inside)
                for name, inside in {**sides, **corners, **middle}.items() if inside.any()}


@lru_cache(maxsize=16)
def _searched(mesh: Unstructured) -> tuple[FloatArray, IntArray]:
    """Cached `Unstructured._best`: a process may build the same mesh several times."""
    return mesh._best()


def quality(points: FloatArray, cells: IntArray) -> FloatArray:
    """(E,) quality 4 sqrt(3) area / (sum of squared edges): 1 for an equilateral triangle, 0 for a
    flat one."""
    corners = points[cells]
    squares = np.sum((corners - np.roll(corners, 1, axis=1)) ** 2, axis=(1, 2))
    return np.asarray(4.0 * np.sqrt(3.0) * signed_measures(points, cells) / squares)


def counter_clockwise(points: FloatArray, cells: IntArray) -> IntArray:
    """The cells (E, 3), with clockwise ones reversed."""
    wrong = signed_measures(points, cells) < 0.0
    return np.where(wrong[:, None], cells[:, ::-1], cells).astype(np.int64)


def _refined(points: FloatArray, cells: IntArray, times: int) -> tuple[FloatArray, IntArray]:
    """Points and cells after splitting each triangle `times` times into four."""
    from skfem import MeshTri

    fine = MeshTri(*map(np.ascontiguousarray, (points.T, cells.T))).refined(times)
    points = np.ascontiguousarray(fine.p.T)
    return points, counter_clockwise(points, fine.t.T)


def _outline(size: tuple[float, float], divisions: tuple[int, int]) -> FloatArray:
    """(B, 2) points of the sides, counter-clockwise from the lower left corner."""
    (width, height), (nx, ny) = size, divisions
    x, y = np.linspace(0.0, width, nx + 1), np.linspace(0.0, height, ny + 1)
    return np.concatenate([
        np.stack([x[:-1], np.zeros(nx)], axis=1), np.stack([np.full(ny, width), y[:-1]], axis=1),
        np.stack([x[:0:-1], np.full(nx, height)], axis=1),
        np.stack([np.zeros(ny), y[:0:-1]], axis=1)])


def _triangulate(points: FloatArray, flat: float) -> IntArray:
    """(E, 3) Delaunay triangles of area above `flat`, m2; three points of one side may form flat
    ones by round-off."""
    try:
        cells = counter_clockwise(points, Delaunay(points).simplices)
    except QhullError:  # so flat as a whole that it has no area to Qhull
        return np.zeros((0, 3), np.int64)
    return cells[signed_measures(points, cells) > flat]


def _smoothed(points: FloatArray, cells: IntArray) -> FloatArray:
    """(N, 2) each point moved to the area-weighted mean of the circumcentres of its triangles (E,
    3)."""
    a = points[cells[:, 0]]
    first, second = points[cells[:, 1]] - a, points[cells[:, 2]] - a
    area = signed_measures(points, cells)
    squares = np.sum(first**2, axis=1), np.sum(second**2, axis=1)
    turned = np.stack([second[:, 1] * squares[0] - first[:, 1] * squares[1],
                       first[:, 0] * squares[1] - second[:, 0] * squares[0]], axis=1)
    weighted = area[:, None] * a + turned / 4.0  # area times circumcentre
    total, weight = np.zeros_like(points), np.zeros(len(points))
    for corner in cells.T:
        np.add.at(total, corner, weighted)
        np.add.at(weight, corner, area)
    return np.asarray(total / weight[:, None])
