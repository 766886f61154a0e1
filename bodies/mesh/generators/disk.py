"""Solid disk meshed by tetrahedra: the brake disk of Liang et al. 2026, Sec. 4.3."""

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.mesh.generators.extrusion import extrude, extruded, interior_points, plan_mesh
from sparsemor.core import FloatArray, InputError, IntArray, Mesh, MeshPlugin, MeshSize

Positive = Annotated[float, Field(gt=0)]
ANGLES = (0, 90, 180, 270)
"""Angles of the probe points on each circle, degrees."""


class Disk(MeshPlugin):
    """Disk: a cylinder about the z axis from z = 0 up, a plane triangulation extruded in layers.

    With the default options: 10 344 tetrahedra and 2715 points. `refine` divides all edge lengths
    by its value, in the plane and along z. Sets: top, bottom, rim (the outer surface), hub (all
    points within its radius), axis, and single points of the top face: centre, and on each circle
    of probes probe_1, probe_2, ... at 0 degrees and probe_1_90, probe_1_180, probe_1_270.
    """

    radius: float = Field(default=0.14, gt=0)
    """Outer radius, m."""
    thickness: float = Field(default=0.013, gt=0)
    """Thickness, m."""
    hub: float = Field(default=0.03, ge=0)
    """Radius of the set `hub`, m."""
    probes: tuple[Positive, ...] = (0.0867, 0.1060, 0.1188, 0.1336)
    """Radii of the circles with mesh points at 0, 90, 180 and 270 degrees (sets `probe_...`), m."""
    triangles: int = Field(default=1724, ge=1)
    """Triangles of the plane triangulation that is extruded; even."""
    rim: int = Field(default=84, ge=8, multiple_of=4)
    """Points on the rim of the plane triangulation that is extruded; a multiple of 4."""
    layers: int = Field(default=2, ge=1)
    """Layers of prisms, each of three tetrahedra."""
    refine: float = Field(default=1.0, gt=0, le=20)
    """Factor on the number of edges along each length: the number of tetrahedra grows with its
    third power."""

    @model_validator(mode="after")
    def _possible(self) -> "Disk":
        """Checks that hub and probes fit into the triangulated circle."""
        interior_points(self.triangles, self.rim)  # for its InputError
        if self.hub >= self.radius:
            raise InputError(f"{self.hub:g} m: the hub must be smaller than the radius, "
                             f"{self.radius:g} m", "hub")
        rim, _, _ = self.counts()
        limit = self.radius * np.cos(np.pi / rim)  # beyond it a point lies between rim and chord
        wrong = [r for r in self.probes if r >= limit]
        if wrong or len(set(self.probes)) < len(self.probes):
            raise InputError(
                f"probes stand on different circles inside the radius, {limit:.4g} m where {rim} "
                f"points make the rim (got {', '.join(f'{r:g}' for r in self.probes)})",
                "probes")
        return self

    def counts(self) -> tuple[int, int, int]:
        """Numbers of points on the rim, triangles of the plane triangulation, and layers, after
        `refine`."""
        rim = max(8, 4 * round(self.rim * self.refine / 4))
        half = max(round(self.triangles * self.refine**2 / 2), rim // 2 + len(self._fixed()))
        return rim, 2 * half, max(1, round(self.layers * self.refine))

    def expected(self) -> MeshSize:
        return extruded(*self.counts())

    def build(self, base: Path) -> Mesh:
        """The mesh; `base` is not used."""
        rim, triangles, layers = self.counts()
        angle = 2 * np.pi * np.arange(rim) / rim
        outline = self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        plan, cells = plan_mesh(outline, triangles, self._fixed())
        points, cells = extrude(plan, cells, np.linspace(0.0, self.thickness, layers + 1))
        return Mesh(points, cells, self._sets(points, rim, len(plan)))

    def _fixed(self) -> FloatArray:
        """(1 + 4 c, 2) prescribed points of the triangulation, m: the axis, then those of each of c
        circles."""
        turns = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
        return np.concatenate([np.zeros((1, 2)), *(r * turns for r in self.probes)])

    def _sets(self, points: FloatArray, rim: int, n: int) -> dict[str, IntArray]:
        """Sets of nodes: the faces, rim, hub, axis and probes. rim: number of points on it, the
        first of the n points of a layer; then follow the axis and the four points of each
        circle."""
        top = len(points) - n
        base = np.arange(0, len(points), n)[:, None]
        near = np.hypot(points[:, 0], points[:, 1]) <= self.hub * (1 + 1e-9)
        sets = {
            "bottom": np.arange(n), "top": top + np.arange(n),
            "rim": (base + np.arange(rim)).ravel(), "hub": np.flatnonzero(near),
            "axis": base.ravel() + rim, "centre": np.array([top + rim]),
        }
        for c in range(len(self.probes)):
            for q, angle in enumerate(ANGLES):
                name = f"probe_{c + 1}" + (f"_{angle}" if angle else "")
                sets[name] = np.array([top + rim + 1 + 4 * c + q])
        return sets
