"""Orthographic view of a body in space, in which lengths parallel to the view plane are true, and
its picture: rendered by pyvista, or drawn plainly by matplotlib."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SECONDS = 300.0
_WORKER = "sparsemor.plugins.charts.surface_pyvista_worker"

@dataclass(frozen=True, slots=True, eq=False)
class View:
    """View direction. axes (3, 3): unit vectors in rows, to the right, upwards, and towards the
    viewer."""

    name: str
    axes: FloatArray

    @classmethod
    def from_angles(cls, name: str, azimuth: float, elevation: float) -> "View":
        """View from the direction `azimuth` (about z, from x) and `elevation` (above the plane z =
        0), degrees."""
        a, e = np.radians([azimuth, elevation])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        return cls(name, np.stack([right, np.cross(towards, right), towards]))

    def rotated(self, points: FloatArray) -> FloatArray:
        """(N, 3) coordinates of points to the right, upwards, and towards the viewer, m."""
        return np.asarray(points @ self.axes.T)


VIEWS = (View.from_angles("from above", -50.0, 40.0), View.from_angles("from below", -50.0, -40.0))
"""Views from above and below, because a contact may heat the lower side."""


@dataclass(frozen=True, slots=True, eq=False)
class BodySurface:
    """Surface of a body in one panel, with the values that colour it.

    corners (b, 3, 3): corners of the triangles in view axes, relative to the centre of the panel,
    m; values (b, 3): in the unit of the colour bar; low, high: limits of the colour scale; colours:
    name of the colour map; half (2,): half of the panel's width and height, m.
    """

    corners: FloatArray
    values: FloatArray
    low: float
    high: float
    colours: str
    half: FloatArray


def middle(points: FloatArray) -> FloatArray:
    """(3,) centre of the bounding box of points (N, 3)."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def half_of(boxes: list[FloatArray]) -> FloatArray:
    """(2,) half of the width and height of a panel that contains each of these point sets, with a
    margin."""
    spans = np.array([0.5 * np.ptp(points[:, :2], axis=0) for points in boxes])
    return np.asarray(spans.max(axis=0) + 0.06 * spans.max())


def front_facing(corners: FloatArray) -> IntArray:
    """Indices of the triangles with corners (b, 3, 3) in view axes that face the viewer, in the
    order of decreasing distance."""
    a, b, c = (corners[:, k] for k in range(3))
    front = np.flatnonzero(np.cross(b - a, c - a)[:, 2] > 0.0)
    return front[np.argsort((a + b + c)[front, 2], kind="stable")]


def paint(axes: "Axes", surface: BodySurface) -> None:
    """Draws a surface by matplotlib into axes with coordinates in metres in the view plane: nearer
    triangles over farther ones."""
    front = front_facing(surface.corners)
    if front.size == 0:
        return
    x, y = surface.corners[front].reshape(-1, 3)[:, :2].T
    axes.tripcolor(
        x, y, surface.values[front].ravel(), triangles=np.arange(x.size).reshape(-1, 3),
        shading="gouraud", cmap=surface.colours, vmin=surface.low, vmax=surface.high,
        rasterized=True)


def rendered(surfaces: Sequence[BodySurface]) -> list[NDArray[np.uint8]] | None:
    """Image (h, w, 3) of each surface, which fills its panel, by pyvista (extra `pictures3d`) off
    screen; None if it is absent or fails.

    It runs in a separate process: VTK may abort its process if neither a display nor EGL or OSMesa
    is available, and it changes global settings.
    """
    if not surfaces or find_spec("pyvista") is None:
        return None
    with TemporaryDirectory() as name:
        folder = Path(name)
        for number, surface in enumerate(surfaces):
            arrays: dict[str, Any] = asdict(surface)
            np.savez(folder / f"{number}.npz", **arrays)
        try:
            done = subprocess.run(
                [sys.executable, "-m", _WORKER, name], check=False, capture_output=True,
                stdin=subprocess.DEVNULL, timeout=_SECONDS)
        except subprocess.TimeoutExpired:
            return None
        files = [folder / f"{number}.npy" for number in range(len(surfaces))]
        if done.returncode != 0 or not all(file.exists() for file in files):
            return None
        images = [np.load(file) for file in files]
    blank = any(image.min() == image.max() for image in images)
    return None if blank else images
