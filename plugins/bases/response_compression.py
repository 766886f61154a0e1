"""Compression of many responses to few orthonormal atoms: their leading singular vectors."""

import numpy as np
from scipy import linalg

from sparsemor.core import BlockData, FloatArray
from sparsemor.plugins.bases.load_patterns import moving_loads
from sparsemor.plugins.bases.orthogonalise import independent
from sparsemor.plugins.bases.snapshot_svd import left_singular, round_off_level


def largest_directions(
    A: FloatArray, first: FloatArray, count: int, rtol: float, rest: float = 0.0
) -> FloatArray:
    """Leading left singular vectors (n, k), at most `count`, of A (n, j) orthogonal to `first` (n,
    p).

    `first` has orthonormal columns; singular values must exceed `rtol` times the largest. rest: see
    `left_singular`.
    """
    for _ in range(2):  # once leaves what cancellation brings back
        A = A - first @ (first.T @ A)
    if not A.any():
        return A[:, :0]
    U, s = left_singular(A, max(rtol, round_off_level(*A.shape)), rest)
    kept = min(count, int(np.count_nonzero(s > rtol * s[0])), len(A) - first.shape[1])
    return U[:, :kept]


def steps_of(data: BlockData) -> int:
    """Number of time steps that the tables of the moving loads cover; 1 if the step is unknown."""
    moving = [*data.moving, *(data.heat.moving if data.heat is not None else ())]
    span = max(m.table.times[-1] - m.table.times[0] for m in moving)
    return max(1, round(float(span) / data.step)) if data.step else 1


def likely_states(heat: BlockData, atoms: FloatArray, tabled: int | None = None) -> FloatArray:
    """Temperatures X (n, k) with X X^T = sum over p of x_p x_p^T, scaled by how large each becomes.

    x_p are the temperatures p steps after unit heat on the path of a moving heat source (or after
    one of `tabled` load shapes), projected on the span of `atoms`. The sum (a controllability
    Gramian) over 2 N delays is W + A^N W (A^N)^T, with W the sum over N delays and A the matrix of
    one step. Returns `atoms` if no heat source moves or the time step is unknown.
    """
    forces, names = moving_loads(heat, None, tabled)
    if not names or not any(heat.factors):
        return atoms
    _, Q = independent(atoms, 1e-12)
    B = Q.T @ (heat.operator @ Q)
    A = linalg.solve(B, Q.T @ ((heat.operator - heat.stiffness) @ Q), assume_a="sym")
    x = linalg.solve(B, Q.T @ forces, assume_a="sym")
    W = x @ x.T
    for _ in range(steps_of(heat).bit_length()):
        W = W + A @ W @ A.T
        A = A @ A
    values, vectors = np.linalg.eigh(W)
    return np.asarray(Q @ (vectors * np.sqrt(np.maximum(values, 0.0))))
