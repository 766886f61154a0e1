"""Resultants of a contact in space at some times: what a history keeps of it."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.contact.spatial.pieces import Overlaps, Pieces, pressure
from sparsemor.bodies.contact.spatial.tractions import Loads
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols import NormalLaw

HISTORIES = ("normal", "friction", "power", "area", "pressure")


def resultants(
    times: int, time: IntArray, overlaps: Overlaps, pieces: Pieces, loads: Loads, law: NormalLaw
) -> Mapping[str, FloatArray]:
    """(times,) each: "normal" and "friction" N, the sizes of the resultants of pressure and of
    friction; "power" W; "area" m2 in contact; "pressure" Pa, the largest. time (P,): number of the
    time of each overlap."""
    at = time[pieces.overlap]
    normal, friction = (
        np.linalg.norm([np.bincount(at, x, times) for x in vectors.T], axis=0)
        for vectors in (loads.push, loads.drag))
    power, area = (np.bincount(at, v, times) for v in (loads.power, loads.area))
    top, polygons = np.zeros(times), pieces.polygons
    p = pressure(overlaps, pieces.of, polygons.places, law)
    np.maximum.at(top, time[pieces.of], np.where(polygons.used, p, 0.0).max(axis=1, initial=0.0))
    return dict(zip(HISTORIES, (normal, friction, power, area, top), strict=True))
