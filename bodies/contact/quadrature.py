"""Gauss rules on segments and triangles, and the number of points that the laws of a contact need.

On a piece of an overlap the penetration, its rate and the slip are linear, so the required rule
depends on the contact laws alone and is chosen once. A number of points that depended on the state
could change within an iteration, and the jump of a resultant by the tolerance has no derivative.
"""

import math
from itertools import pairwise, product

import numpy as np
from scipy.special import roots_jacobi

from sparsemor.core import FloatArray, FrictionLaw, InputError, NormalLaw

FEWEST, MOST = {2: 3, 3: 2}, {2: 24, 3: 12}
"""Smallest and largest number of points along a side, by dimension."""
PRESCRIBED = 8
"""Smallest number of points per piece in the plane for loads along a prescribed motion."""


def rule(d: int, n: int) -> tuple[FloatArray, FloatArray]:
    """Gauss rule with n points along a side of a facet in d dimensions: barycentric points (n^(d -
    1), d) and weights with sum 1 / (d - 1)!; exact to degree 2 n - 1.

    On triangles Gauss-Legendre along lines through a corner, Gauss-Jacobi across them (Stroud's
    product rule).
    """
    along, v = np.polynomial.legendre.leggauss(n)
    along, v = 0.5 * (along + 1.0), 0.5 * v
    if d == 2:
        return np.stack([1.0 - along, along], axis=1), v
    across, w = roots_jacobi(n, 1.0, 0.0)  # lines through the corner have the length 1 - x
    x = 0.5 * (across + 1.0)[:, None]
    y = along[None] * (1.0 - x)
    x = x + 0.0 * y
    return np.stack([1.0 - x - y, x, y], axis=2).reshape(-1, 3), (0.25 * w[:, None] * v).ravel()


def points_along(d: int, points: FloatArray) -> int:
    """Number n of points along a side of a rule with points (n^(d - 1), d)."""
    return int(round(math.pow(len(points), 1.0 / (d - 1))))


def enough_points(
    d: int, normal: NormalLaw, friction: FrictionLaw | None, tolerance: float
) -> int:
    """Smallest number of points along a side for which doubling it changes no resultant by more
    than the relative `tolerance`.

    Tested on facets whose penetration and slip lie between the breaks of the laws and far beyond
    them. InputError if MOST[d] points are not enough.
    """
    depth, rate, slip = _trials(d, normal, friction)
    for n in range(FEWEST[d], MOST[d] + 1):
        coarse, fine = (_resultants(depth, rate, slip, normal, friction, k) for k in (n, 2 * n))
        size = np.abs(fine).max(axis=1, keepdims=True)
        if np.all(np.abs(coarse - fine) <= tolerance * size):
            return n
    rules = f"{MOST[2]} Gauss points a piece" if d == 2 else f"{MOST[3]}^2 Gauss points a triangle"
    raise InputError(f"{rules} leave more than {tolerance:g} of the resultant open: the laws are "
                     "not smooth between their `breaks`; raise it", "tolerance")


TURNING = np.array([[1.0, 0.0], [1.0, 0.25], [1.25, 0.0]])
"""Test slip at the corners of a triangle, in units of a speed: direction and magnitude vary by a
quarter."""


def _trials(
    d: int, normal: NormalLaw, friction: FrictionLaw | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Test states of `enough_points`: penetration (n, d), m, at the corners, penetration rate (n,
    1), m/s, and slip (n, d, d - 1), m/s, at the corners: all combinations of layers of penetration
    (ramps), two rates, and slips. breaks: where a law is not smooth, at which facets are cut.

    Order of the return values: penetration, rate, slip.
    """
    depths = [0.0, *normal.breaks]
    last, unit = depths[-1], depths[-1] or 1e-9
    # between breaks, and from the last one up to 10^5 times as deep
    layers = [*pairwise(depths), *((last, last + unit * 10.0**k) for k in range(6))]
    breaks = friction.breaks if friction else ()
    slips = _slips_in_plane(breaks) if d == 2 else _slips_in_space(breaks)
    ramps: list[tuple[float, ...]] = [*layers] if d == 2 else [
        ramp for a, b in layers for ramp in ((a, a, b), (a, b, b))]
    made = list(product(ramps, (0.0, 1e-3), slips))
    return (np.array([e for e, _, _ in made]), np.array([[r] for _, r, _ in made]),
            np.array([s for _, _, s in made]))


def _slips_in_plane(breaks: tuple[float, ...]) -> list[FloatArray]:
    """Slips (2, 1) at the ends of a segment, m/s: linear between consecutive breaks of the friction
    law, where pieces are cut."""
    far = 10.0 * max(map(abs, breaks), default=1.0)
    return [np.array([[a], [b]]) for a, b in pairwise([-far, *sorted(breaks), far])]


def _slips_in_space(breaks: tuple[float, ...]) -> list[FloatArray]:
    """Slips (3, 2) at the corners of a triangle, m/s: below the smallest break speed of the
    friction law, through zero, and upwards from each break."""
    speeds = sorted({abs(b) for b in breaks} - {0.0})
    slow = 0.75 * speeds[0] if speeds else 1.0
    across = np.array([[-1.0, 0.0], [1.0, 0.5], [0.5, -1.0]])
    return [slow * TURNING, slow * across, *(b * TURNING for b in speeds)]


def _resultants(
    depth: FloatArray, rate: FloatArray, slip: FloatArray, normal: NormalLaw,
    friction: FrictionLaw | None, n: int,
) -> FloatArray:
    """(k, trials) normal force, its moment, friction force (in space), its moment and power of each
    test state, by the rule with n points along a side; depth, rate, slip: as of `_trials`; moments:
    with the barycentric coordinate x of corner 1 as the arm."""
    d = depth.shape[1]
    points, weights = rule(d, n)
    delta, v = depth @ points.T, np.einsum("qi,tik->tqk", points, slip)
    p, x = normal.pressure(delta, rate + 0.0 * delta)[0], points[:, 1]
    speed = v[:, :, 0] if d == 2 else np.linalg.norm(v, axis=2)
    traction = friction.ratio(speed)[0] * p if friction else 0.0 * p
    along = v / np.where(speed != 0, speed, 1.0)[:, :, None] * traction[:, :, None]
    forces = along.transpose(2, 0, 1) if d == 3 else ()
    parts = (p, p * x, *forces, along[:, :, -1] * x, traction * speed)
    return np.stack([f @ weights for f in parts], axis=1)
