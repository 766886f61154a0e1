"""Mean displacement and mean rotation of a set of nodes, such as a bore or an end face, and
loads on them: columns over all d N nodal displacements, number d * node + component.
"""

import numpy as np

from sparsemor.bodies.frames.rotation import GENERATORS
from sparsemor.core import FloatArray


def mean_displacement(weights: FloatArray, d: int) -> FloatArray:
    """(d N, d) columns of the weighted sum of the displacements along each axis; weights (N,)."""
    return np.asarray(np.kron(weights[:, None], np.eye(d)))


def with_torques(forces: FloatArray) -> FloatArray:
    """(d N, 1 + r) nodal forces (N, d) as a load column, and columns of the r functionals sum u x
    f."""
    G = GENERATORS[forces.shape[1]]
    torques = np.einsum("acb,nc->nba", G, forces).reshape(-1, len(G))
    return np.concatenate([forces.reshape(-1, 1), torques], axis=1)


def mean_rotation(weights: FloatArray, X: FloatArray) -> FloatArray:
    """(d N, d) columns of the mean rotation (rad) of weighted points X (N, d), by least squares.

    Minimises sum w |u - u_mean - theta x arm|^2. In the plane a zero column follows, because
    functionals come in pairs there. LinAlgError if the points lie on one line, in the plane at one
    position.
    """
    arm = X - weights @ X
    lever = np.einsum("aij,nj->nia", GENERATORS[X.shape[1]], arm)  # e_a x arm
    J = np.einsum("n,nia,nib->ab", weights, lever, lever)
    if not np.linalg.cond(J) <= 1e12:
        raise np.linalg.LinAlgError
    turn = (weights[:, None, None] * lever).reshape(X.size, -1) @ np.linalg.inv(J)
    return np.asarray(np.pad(turn, ((0, 0), (0, X.shape[1] - turn.shape[1]))))
