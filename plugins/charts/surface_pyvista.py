"""Surfaces of bodies rendered by pyvista (extra `pictures3d`) off screen, in a separate process.

VTK may abort its process if neither a display nor EGL or OSMesa is available, and it changes global
settings. A picture that it fails to render is drawn plainly by matplotlib (`view.paint`).
"""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.plugins.charts.view import BodySurface

_SECONDS = 300.0
_WORKER = "sparsemor.plugins.charts.surface_pyvista_worker"


def rendered(surfaces: Sequence[BodySurface]) -> list[NDArray[np.uint8]] | None:
    """Image (h, w, 3) of each surface, which fills its panel; None if pyvista is absent or
    fails."""
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
