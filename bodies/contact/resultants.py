"""Force resultants of a contact: the quantities that a run records."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.contact.pieces import Overlaps, Pieces, pressure
from sparsemor.bodies.contact.tractions import Interface, Loads
from sparsemor.core import FloatArray, IntArray


def names_of(d: int) -> tuple[str, ...]:
    """Names of the recorded resultants in dimension d.

    "normal" and "friction": magnitudes of the resultants of pressure and of friction, N; "power":
    friction power, W; "length" (m) in the plane or "area" (m2) in contact; "pressure": its maximum,
    Pa.
    """
    return "normal", "friction", "power", "length" if d == 2 else "area", "pressure"


def resultants(
    times: int, time: IntArray, o: Overlaps, pieces: Pieces, loads: Loads, face: Interface
) -> Mapping[str, FloatArray]:
    """Resultants (times,) by the names of `names_of`; time (P,): number of the time of each
    overlap."""
    at = time[pieces.overlap]
    normal, friction = (
        np.linalg.norm([np.bincount(at, x, times) for x in vectors.T], axis=0)
        for vectors in (loads.push, loads.drag))
    power, size = (np.bincount(at, v, times) for v in (loads.power, loads.area / face.width))
    top = np.zeros(times)
    p = pressure(o, pieces.of, pieces.parts.corners, face.normal)
    np.maximum.at(top, time[pieces.of], np.where(pieces.parts.used, p, 0.0).max(
        axis=1, initial=0.0))
    return dict(zip(names_of(o.d), (normal, friction, power, size, top), strict=True))
