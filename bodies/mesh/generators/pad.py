"""Brake pad of the disk brake: a curved outline, extruded."""

from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.mesh.generators.extrusion import extrude, extruded, interior_points, plan_mesh
from sparsemor.core import FloatArray, Mesh, MeshPlugin, MeshSize

OUTER = np.array([[0.0, 0.135], [0.02, 0.135], [0.05, 0.13], [0.04, 0.105]])
INNER = np.array([[0.04, 0.105], [0.03, 0.08], [0.035, 0.09], [0.0, 0.09]])
OUTER_WEIGHTS, INNER_WEIGHTS = np.array([1.0, 1.0, 2.5, 1.0]), np.ones(4)
"""Control points (m) and weights of the Bezier curves that form the right half of the outline: the
pad of COMSOL's "Heat Generation in a Disc Brake"."""


class Pad(MeshPlugin):
    """Brake pad: an outline of two rational cubic Bezier curves and their mirror images in x.

    With the default options: 900 tetrahedra and 279 points. Sets: bottom (the friction face),
    top, side, and single points of the top face: top_outer, top_inner (on x = 0), top_left,
    top_right (where the curves meet).
    """

    bottom: float = 0.013
    """z coordinate of the friction face, m."""
    thickness: float = Field(default=0.0065, gt=0)
    """Thickness, m."""
    triangles: int = Field(default=150, ge=1)
    """Triangles of the plane triangulation that is extruded; even."""
    outline: int = Field(default=34, ge=12, multiple_of=2)
    """Points on the outline of the plane triangulation that is extruded; even."""
    layers: int = Field(default=2, ge=1)
    """Layers of prisms, each of three tetrahedra."""
    refine: float = Field(default=1.0, gt=0, le=20)
    """Factor on the number of edges along each length: the number of tetrahedra grows with its
    third power."""

    @model_validator(mode="after")
    def _possible(self) -> "Pad":
        interior_points(self.triangles, self.outline)
        return self

    def counts(self) -> tuple[int, int, int]:
        """Numbers of points on the outline, triangles of the plane triangulation, and layers, after
        `refine`."""
        outline = max(12, 2 * round(self.outline * self.refine / 2))
        half = max(round(self.triangles * self.refine**2 / 2), outline // 2)
        return outline, 2 * half, max(1, round(self.layers * self.refine))

    def expected(self) -> MeshSize:
        return extruded(*self.counts())

    def build(self, base: Path) -> Mesh:
        """The mesh; `base` is not used. The outline has the first `count` of the n points of each
        layer, those of the top come last; corners: name -> number on the outline."""
        count, triangles, layers = self.counts()
        outline, corners = pad_outline(count)
        plan, cells = plan_mesh(outline, triangles)
        heights = self.bottom + np.linspace(0.0, self.thickness, layers + 1)
        points, cells = extrude(plan, cells, heights)
        n, top = len(plan), len(points) - len(plan)
        side = np.arange(0, len(points), n)[:, None] + np.arange(count)
        sets = {"bottom": np.arange(n), "top": top + np.arange(n), "side": side.ravel()}
        sets |= {name: np.array([top + i]) for name, i in corners.items()}
        return Mesh(points, cells, sets)


def pad_outline(count: int) -> tuple[FloatArray, dict[str, int]]:
    """(count, 2) points of the outline, m, counter-clockwise, and the numbers of the points where
    curves meet.

    Each curve has a number of points in proportion to its length, at equal distances.
    """
    outer, inner = _curve(OUTER, OUTER_WEIGHTS), _curve(INNER, INNER_WEIGHTS)
    lengths = [float(np.linalg.norm(np.diff(c, axis=0), axis=1).sum()) for c in (outer, inner)]
    above = min(max(round(count / 2 * lengths[0] / sum(lengths)), 2), count // 2 - 2)
    below = count // 2 - above
    # both run clockwise on the right side, so the mirror images run counter-clockwise
    right = np.concatenate([_spaced(outer, above)[:-1], _spaced(inner, below)])
    left = (right * [-1.0, 1.0])[1:-1]
    points = np.concatenate([right[::-1], left])
    right_corner, top = below, above + below
    return points, {"top_inner": 0, "top_right": right_corner, "top_outer": top,
                    "top_left": top + above}


def _curve(points: FloatArray, weights: FloatArray) -> FloatArray:
    """(4001, 2) closely spaced points of a rational cubic Bezier curve."""
    t = np.linspace(0.0, 1.0, 4001)[:, None]
    share = weights * np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    return np.asarray(share @ points / share.sum(axis=1, keepdims=True))


def _spaced(curve: FloatArray, edges: int) -> FloatArray:
    """(edges + 1, 2) points at equal distances along a curve given by close points, both ends
    included."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], edges + 1)
    spaced = np.stack([np.interp(at, along, x) for x in curve.T], axis=1)
    spaced[[0, -1]] = curve[[0, -1]]
    return spaced
