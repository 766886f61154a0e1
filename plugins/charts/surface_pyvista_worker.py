"""Process that renders surfaces with pyvista: `python -m` this module, with a folder as argument.

Reads 0.npz, 1.npz, .. in the folder, as `rendered` writes them, and writes an image (h, w, 3) of
bytes to 0.npy, 1.npy, .. for each.
"""

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

PIXELS = 700
"""Number of pixels along the longer side of a panel."""
LIGHT = np.array([-0.3, 0.3, 0.9]) / np.sqrt(0.99)
"""Direction of the light source, a unit vector in view axes: upper left, behind the viewer."""
DARKEST = 0.7
"""Brightness of surfaces that no light reaches; close to 1, so that colours remain readable as
values."""


def _render(file: Path) -> None:
    """Renders the surface in a file of arrays and stores the picture next to it: corners (b, 3, 3)
    of triangles in view axes (z towards the viewer), m, relative to the centre of the panel, whose
    half width and height are half (2,); values (b, 3) that colour them between low and high."""
    pyvista: Any = import_module("pyvista")
    with np.load(file) as data:
        corners, values, half = data["corners"], data["values"], data["half"]
        ends, colours = (float(data["low"]), float(data["high"])), str(data["colours"])
    points, where = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    of_points = np.zeros(len(points))
    of_points[where.ravel()] = values.ravel()
    skin = pyvista.PolyData.from_regular_faces(points, where.reshape(-1, 3))
    size = np.maximum(1, np.round(PIXELS * half / half.max()).astype(int))
    far = 10.0 * float(np.abs(corners).max() + half.max())
    plotter = pyvista.Plotter(off_screen=True, window_size=size.tolist(), lighting="none")
    plotter.add_light(pyvista.Light(position=tuple(far * LIGHT), light_type="scene light"))
    plotter.set_background("white")
    plotter.add_mesh(
        skin, scalars=of_points, clim=ends, cmap=colours, show_scalar_bar=False,
        smooth_shading=True, split_sharp_edges=True, ambient=DARKEST, diffuse=1.0 - DARKEST,
        specular=0.0)
    plotter.camera_position = [(0.0, 0.0, far), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = float(half[1])
    plotter.reset_camera_clipping_range()
    plotter.enable_anti_aliasing("ssaa")
    image = plotter.screenshot(None, return_img=True)
    np.save(file.with_suffix(".npy"), image)
    plotter.close()


if __name__ == "__main__":
    for file in sorted(Path(sys.argv[1]).glob("*.npz")):
        _render(file)
