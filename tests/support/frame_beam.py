"""Consistent matrices of an Euler-Bernoulli beam along x, with rotations, in the plane and in
space."""

from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray


def element(
    length: float, EA: float, EI: tuple[float, float], GJ: float, mass: float, polar: float
) -> tuple[FloatArray, FloatArray]:
    """M and K (12, 12) of an element; EI: about z and y; mass, kg/m; polar: moment of inertia about
    x per length, kg m."""
    h, K, M = length, np.zeros((12, 12)), np.zeros((12, 12))
    rod, flat = np.array([[1.0, -1.0], [-1.0, 1.0]]) / h, np.array([[2.0, 1.0], [1.0, 2.0]]) * h / 6
    for at, stiff, heavy in (([0, 6], EA, mass), ([3, 9], GJ, polar)):
        K[np.ix_(at, at)] = stiff * rod
        M[np.ix_(at, at)] = heavy * flat
    for at, stiff, sign in (([1, 5, 7, 11], EI[0], 1.0), ([2, 4, 8, 10], EI[1], -1.0)):
        D = np.diag([1.0, sign, 1.0, sign])
        bend = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                         [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]) / h**3
        inert = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                          [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])
        K[np.ix_(at, at)] = stiff * D @ bend @ D
        M[np.ix_(at, at)] = mass * h / 420 * D @ inert @ D
    return M, K


def beam(
    n: int, length: float, *, d: int = 3, EA: float = 1e6, EI: tuple[float, float] = (40.0, 60.0),
    GJ: float = 30.0, mass: float = 2.0, polar: float = 1e-4,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes (n + 1, d), M and K of n elements: 6 unknowns for each node, in the plane 3."""
    M, K = np.zeros((2, 6 * (n + 1), 6 * (n + 1)))
    for e in range(n):
        at = slice(6 * e, 6 * e + 12)
        m, k = element(length / n, EA, EI, GJ, mass, polar)
        M[at, at] += m
        K[at, at] += k
    X = np.zeros((n + 1, d))
    X[:, 0] = np.linspace(0.0, length, n + 1)
    keep = np.arange(6 * (n + 1)) if d == 3 else (
        6 * np.arange(n + 1)[:, None] + np.array([0, 1, 5])).ravel()
    return X, M[np.ix_(keep, keep)], K[np.ix_(keep, keep)]


def saved(folder: Any, X: FloatArray, **matrices: FloatArray) -> dict[str, str]:
    """Options of a body with these nodes and matrices, written to files."""
    for key, value in {"nodes": X, **matrices}.items():
        np.save(folder / f"{key}.npy", value)
    return {key: str(folder / f"{key}.npy") for key in ("nodes", *matrices)}
