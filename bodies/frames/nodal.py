"""Nodal direction vectors: columns over all 3 N displacements, number 3 * node + component."""

import numpy as np

from sparsemor.bodies.frames.rotation import LEVI_CIVITA
from sparsemor.core import FloatArray


def along(weights: FloatArray) -> FloatArray:
    """(3 N, 3): the weighted sum of u along each axis."""
    return np.asarray(np.kron(weights[:, None], np.eye(3)))


def with_torques(forces: FloatArray) -> FloatArray:
    """(3 N, 4): nodal forces (N, 3) as a load, and the three functionals sum u x f."""
    torques = np.einsum("abc,nc->nba", LEVI_CIVITA, forces)  # (u x f)_a = eps_abc u_b f_c
    return np.concatenate([forces.reshape(-1, 1), torques.reshape(-1, 3)], axis=1)


def mean_turn(weights: FloatArray, X: FloatArray) -> FloatArray:
    """(3 N, 3): mean rotation (rad) of the weighted points X (N, 3), by least squares.

    Minimises sum w |u - u_mean - theta x arm|^2. The points must not lie on one line: LinAlgError.
    """
    arm = X - weights @ X
    T = (weights[:, None] * arm).T @ arm
    J = np.trace(T) * np.eye(3) - T
    if np.linalg.cond(J) > 1e12:
        raise np.linalg.LinAlgError
    lever = np.einsum("abc,nb->nca", LEVI_CIVITA, weights[:, None] * arm)  # (arm x u)_a
    return np.asarray(lever.reshape(-1, 3) @ np.linalg.inv(J))
