"""Points of a scene that are outside of the body that they belong to."""

from collections.abc import Iterator, Sequence

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Note

OUTSIDE = 1e-2
"""Distance of a point from a body's bounding box, relative to the box's diagonal, above which there
is a warning."""


def outside_box_notes(key: str, point: Sequence[float], points: FloatArray) -> Iterator[Note]:
    """Warning if a point (d,) is outside the bounding box of points (N, d), m; key: name of the
    point in the scene."""
    at, low, high = np.asarray(point, dtype=np.float64), points.min(axis=0), points.max(axis=0)
    away = float(np.linalg.norm(at - np.clip(at, low, high)))
    size = float(np.linalg.norm(high - low))
    if away > OUTSIDE * size:
        nearest = points[np.argmin(np.linalg.norm(points - at, axis=1))]
        yield Note(f"{key} at {_point(at)} is {away:.3g} m outside its body, whose diagonal is "
                   f"{size:.3g} m: the nearest node at {_point(nearest)} is taken", "distant_point")


def _point(p: FloatArray) -> str:
    return "(" + ", ".join(f"{c:.6g}" for c in p) + ")"
