"""Many responses pooled to few orthonormal atoms: the directions in which they are largest."""

import numpy as np
from scipy import linalg

from sparsemor.core import BlockData, FloatArray
from sparsemor.plugins.bases.load_patterns import moving_loads
from sparsemor.plugins.bases.orthogonalise import independent
from sparsemor.plugins.bases.randomized_svd import left_singular, round_off_level


def largest_directions(
    A: FloatArray, first: FloatArray, count: int, rtol: float
) -> FloatArray:
    """(n, k): at most `count` left singular vectors of A (n, j), orthogonal to `first` (n, p) with
    orthonormal columns, whose singular value is above `rtol` of the largest."""
    for _ in range(2):  # once leaves what cancellation brings back
        A = A - first @ (first.T @ A)
    if not A.any():
        return A[:, :0]
    U, s = left_singular(A, max(rtol, round_off_level(*A.shape)))
    kept = min(count, int(np.count_nonzero(s > rtol * s[0])), len(A) - first.shape[1])
    return U[:, :kept]


def steps_of(data: BlockData) -> int:
    """Number of steps covered by the tables of the moving loads."""
    span = max(m.table.times[-1] - m.table.times[0] for m in data.moving)
    return max(1, round(float(span) / data.step)) if data.step else 1


def likely_states(heat: BlockData, atoms: FloatArray, tabled: int | None = None) -> FloatArray:
    """X (n, k) with X X^T = sum over p of x_p x_p^T, x_p the temperatures p steps after unit heat
    on the path (or `tabled` shapes of it), projected on the span of `atoms`: how large each of them
    gets.

    The sum (a controllability Gramian) over 2 N delays is that over N, W, and A^N W (A^N)^T. The
    atoms themselves where no heat moves or the step is not known.
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
