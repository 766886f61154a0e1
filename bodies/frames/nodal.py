"""Nodal direction vectors: columns over all d N displacements, number d * node + component."""

import numpy as np

from sparsemor.bodies.frames.rotation import GENERATORS
from sparsemor.core import FloatArray


def along(weights: FloatArray, d: int) -> FloatArray:
    """(d N, d): the weighted sum of u along each axis."""
    return np.asarray(np.kron(weights[:, None], np.eye(d)))


def with_torques(forces: FloatArray) -> FloatArray:
    """(d N, 1 + r): nodal forces (N, d) as a load, and the r functionals sum u x f."""
    G = GENERATORS[forces.shape[1]]
    torques = np.einsum("acb,nc->nba", G, forces).reshape(-1, len(G))
    return np.concatenate([forces.reshape(-1, 1), torques], axis=1)


def mean_turn(weights: FloatArray, X: FloatArray) -> FloatArray:
    """(d N, d): mean rotation (rad) of the weighted points X (N, d), by least squares; in the
    plane a column of zeros follows it, because directions come in pairs there.

    Minimises sum w |u - u_mean - theta x arm|^2. The points must not lie on one line, in the plane
    not at one place: LinAlgError.
    """
    arm = X - weights @ X
    lever = np.einsum("aij,nj->nia", GENERATORS[X.shape[1]], arm)  # e_a x arm
    J = np.einsum("n,nia,nib->ab", weights, lever, lever)
    if not np.linalg.cond(J) <= 1e12:
        raise np.linalg.LinAlgError
    turn = (weights[:, None, None] * lever).reshape(X.size, -1) @ np.linalg.inv(J)
    return np.asarray(np.pad(turn, ((0, 0), (0, X.shape[1] - turn.shape[1]))))
