"""Gauss rules on triangles, and how many points the laws of a contact need on each piece.

As in the plane the number is decided once, from the laws and the tolerance: one that depended on
the state could change within an iteration (contact/quadrature.py).
"""

from itertools import product

import numpy as np
from scipy.special import roots_jacobi

from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols import FrictionLaw, NormalLaw

MOST = 12


def triangle_rule(n: int) -> tuple[FloatArray, FloatArray]:
    """Barycentric points (n^2, 3) and weights (n^2,), whose sum is 1/2; exact to degree 2 n - 1.

    Gauss-Legendre along lines through a corner, Gauss-Jacobi across them (Stroud's product rule).
    """
    across, w = roots_jacobi(n, 1.0, 0.0)
    along, v = np.polynomial.legendre.leggauss(n)
    x = 0.5 * (across + 1.0)[:, None]
    y = 0.5 * (along + 1.0)[None] * (1.0 - x)
    x = x + 0.0 * y
    points = np.stack([1.0 - x - y, x, y], axis=2).reshape(-1, 3)
    return points, (0.125 * w[:, None] * v[None]).ravel()


def enough_points(normal: NormalLaw, friction: FrictionLaw | None, tolerance: float) -> int:
    """Least n for which twice as many points along each side change no resultant by more than
    `tolerance`, tried on triangles that lie between the breaks of the laws, where the slip turns
    and changes by up to a quarter. InputError when 12 do not do."""
    depth, rate, slip = _trials(normal, friction)
    for n in range(2, MOST + 1):
        coarse, fine = (_resultants(depth, rate, slip, normal, friction, k) for k in (n, 2 * n))
        size = np.abs(fine).max(axis=1, keepdims=True)
        if np.all(np.abs(coarse - fine) <= tolerance * size):
            return n
    raise InputError(f"{MOST}^2 Gauss points a triangle leave more than {tolerance:g} of the "
                     "resultant open: the laws are not smooth between their `breaks`; raise it",
                     "tolerance")


TURNING = np.array([[1.0, 0.0], [1.0, 0.25], [1.25, 0.0]])
"""Slip at the corners of a triangle, in units of a speed."""


def _trials(
    normal: NormalLaw, friction: FrictionLaw | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Penetration (n, 3) and slip (n, 3, 2) at the corners, rate of the penetration (n, 1)."""
    depths = [0.0, *normal.breaks]
    last, unit = depths[-1], depths[-1] or 1e-9
    layers = [*zip(depths, depths[1:], strict=False),
              *((last, last + unit * 10.0**k) for k in range(6))]
    ramps = [(a, b, c) for d in layers for a, b, c in ((d[0], d[0], d[1]), (d[0], d[1], d[1]))]
    speeds = sorted({abs(b) for b in friction.breaks} - {0.0}) if friction else []
    slow = 0.75 * speeds[0] if speeds else 1.0
    slips = [slow * TURNING, slow * np.array([[-1.0, 0.0], [1.0, 0.5], [0.5, -1.0]])]
    slips += [b * TURNING for b in speeds]
    made = list(product(ramps, (0.0, 1e-3), slips))
    return (np.array([d for d, _, _ in made]), np.array([[r] for _, r, _ in made]),
            np.array([s for _, _, s in made]))


def _resultants(
    depth: FloatArray, rate: FloatArray, slip: FloatArray, normal: NormalLaw,
    friction: FrictionLaw | None, n: int,
) -> FloatArray:
    """(trials, 6): normal force, its moment, friction force, its moment and power."""
    points, weights = triangle_rule(n)
    d, v = depth @ points.T, np.einsum("qi,tik->tqk", points, slip)
    p = normal.pressure(d, rate + 0.0 * d)[0]
    speed = np.linalg.norm(v, axis=2)
    heat = friction.ratio(speed)[0] * p if friction else 0.0 * p
    along = v / np.where(speed > 0, speed, 1.0)[:, :, None] * heat[:, :, None]
    x = points[:, 1]
    parts = (p, p * x, along[:, :, 0], along[:, :, 1], along[:, :, 1] * x, heat * speed)
    return np.stack([f @ weights for f in parts], axis=1)
