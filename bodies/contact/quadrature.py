"""How many Gauss points a piece gets: decided once, from the laws and the tolerance.

On a piece the penetration, its rate and the slip are linear, whatever the bodies do, so the laws
alone decide which rule integrates them. A number that depended on the state could change within
an iteration, and a resultant that jumps by the tolerance has no derivative.
"""

from itertools import product

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols import FrictionLaw, NormalLaw

MOST = 24


def gauss(points: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights (q,) of the Gauss-Legendre rule on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(points)
    return (x + 1.0) / 2.0, w / 2.0


def enough_points(normal: NormalLaw, friction: FrictionLaw | None, tolerance: float) -> int:
    """Least number for which twice as many points change no resultant by more than `tolerance`.

    Tried on ramps of penetration and slip between the breaks of the laws and far beyond: force,
    moment and friction power. InputError when 24 points do not do.
    """
    ramps = _ramps(normal, friction)
    for points in range(3, MOST + 1):
        coarse, fine = (_resultants(ramps, normal, friction, n) for n in (points, 2 * points))
        size = np.abs(fine).max(axis=1, keepdims=True)
        if np.all(np.abs(coarse - fine) <= tolerance * size):
            return points
    raise InputError(f"{MOST} Gauss points a piece leave more than {tolerance:g} of the resultant "
                     "open: the laws are not smooth between their `breaks`; raise it", "tolerance")


Ramp = tuple[float, float, float, float, float]
"""Penetration at both ends, its rate, slip at both ends."""


def _ramps(normal: NormalLaw, friction: FrictionLaw | None) -> list[Ramp]:
    depths = [0.0, *normal.breaks]
    last, unit = depths[-1], depths[-1] or 1e-9
    layers = [*zip(depths, depths[1:], strict=False),
              *((last, last + unit * 10.0**k) for k in range(6))]
    slips = sorted(friction.breaks) if friction else []
    far = 10.0 * max(map(abs, slips), default=1.0)
    speeds = [-far, *slips, far]
    return [(d0, d1, rate, v0, v1) for (d0, d1), rate, (v0, v1) in product(
        layers, (0.0, 1e-3), zip(speeds, speeds[1:], strict=False))]


def _resultants(
    ramps: list[Ramp], normal: NormalLaw, friction: FrictionLaw | None, points: int
) -> FloatArray:
    """(ramps, 4): normal force, its moment, friction force and power of each ramp."""
    x, w = gauss(points)
    d0, d1, rate, v0, v1 = np.array(ramps).T[:, :, None]
    slip = v0 + (v1 - v0) * x
    p = normal.pressure(d0 + (d1 - d0) * x, rate + 0.0 * x)[0]
    traction = p * friction.ratio(slip)[0] if friction else 0.0 * p
    parts = (p, p * x, traction * x, traction * slip)
    return np.stack([f @ w for f in parts], axis=1)
