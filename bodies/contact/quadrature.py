"""Gauss rules on segments and triangles, and how many points the laws of a contact need on each.

On a piece the penetration, its rate and the slip are linear, whatever the bodies do, so the laws
alone decide which rule integrates them, once. A number that depended on the state could change
within an iteration, and a resultant that jumps by the tolerance has no derivative.
"""

import math
from itertools import pairwise, product

import numpy as np
from scipy.special import roots_jacobi

from sparsemor.core import FloatArray, FrictionLaw, InputError, NormalLaw

FEWEST, MOST = {2: 3, 3: 2}, {2: 24, 3: 12}
"""Numbers of points along a side that are tried, by dimension."""
PRESCRIBED = 8
"""Least number of points a piece in the plane for loads along a prescribed motion."""


def rule(d: int, n: int) -> tuple[FloatArray, FloatArray]:
    """Barycentric points (n^(d - 1), d) and weights of a facet, whose sum is 1 / (d - 1)!; exact to
    degree 2 n - 1.

    On triangles Gauss-Legendre along lines through a corner, Gauss-Jacobi across them (Stroud's
    product rule).
    """
    along, v = np.polynomial.legendre.leggauss(n)
    along, v = 0.5 * (along + 1.0), 0.5 * v
    if d == 2:
        return np.stack([1.0 - along, along], axis=1), v
    across, w = roots_jacobi(n, 1.0, 0.0)
    x = 0.5 * (across + 1.0)[:, None]
    y = along[None] * (1.0 - x)
    x = x + 0.0 * y
    return np.stack([1.0 - x - y, x, y], axis=2).reshape(-1, 3), (0.25 * w[:, None] * v).ravel()


def points_along(d: int, points: FloatArray) -> int:
    """n of the points (n^(d - 1), d) of a rule."""
    return int(round(math.pow(len(points), 1.0 / (d - 1))))


def enough_points(
    d: int, normal: NormalLaw, friction: FrictionLaw | None, tolerance: float
) -> int:
    """Least n for which twice as many points along each side change no resultant by more than
    `tolerance`, tried on facets that lie between the breaks of the laws and far beyond. InputError
    when MOST[d] do not do."""
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
"""Slip at the corners of a triangle, in units of a speed: it turns and changes by a quarter."""


def _trials(
    d: int, normal: NormalLaw, friction: FrictionLaw | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Penetration (n, d) and slip (n, d, d - 1) at the corners, rate of the penetration (n, 1)."""
    depths = [0.0, *normal.breaks]
    last, unit = depths[-1], depths[-1] or 1e-9
    layers = [*pairwise(depths), *((last, last + unit * 10.0**k) for k in range(6))]
    breaks = friction.breaks if friction else ()
    slips = _slips_in_plane(breaks) if d == 2 else _slips_in_space(breaks)
    ramps: list[tuple[float, ...]] = [*layers] if d == 2 else [
        ramp for a, b in layers for ramp in ((a, a, b), (a, b, b))]
    made = list(product(ramps, (0.0, 1e-3), slips))
    return (np.array([e for e, _, _ in made]), np.array([[r] for _, r, _ in made]),
            np.array([s for _, _, s in made]))


def _slips_in_plane(breaks: tuple[float, ...]) -> list[FloatArray]:
    """(2, 1) each: between breaks, where pieces are cut."""
    far = 10.0 * max(map(abs, breaks), default=1.0)
    return [np.array([[a], [b]]) for a, b in pairwise([-far, *sorted(breaks), far])]


def _slips_in_space(breaks: tuple[float, ...]) -> list[FloatArray]:
    """(3, 2) each: below the least speed of a break, across zero, and from each break up."""
    speeds = sorted({abs(b) for b in breaks} - {0.0})
    slow = 0.75 * speeds[0] if speeds else 1.0
    across = np.array([[-1.0, 0.0], [1.0, 0.5], [0.5, -1.0]])
    return [slow * TURNING, slow * across, *(b * TURNING for b in speeds)]


def _resultants(
    depth: FloatArray, rate: FloatArray, slip: FloatArray, normal: NormalLaw,
    friction: FrictionLaw | None, n: int,
) -> FloatArray:
    """(trials, k): normal force, its moment, friction force (in space), its moment and power."""
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
