"""Sparse non-negative least squares with early termination at a given residual norm.

The active-set method of Lawson and Hanson (1974, doi 10.1137/1.9781611971217, ch. 23) adds one
column per iteration, so that early termination gives few nonzeros: the greedy solver of Farhat et
al. 2014. scipy.optimize.nnls iterates to optimality and has no such termination. The QR factors of
the active columns are updated, not recomputed.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import qr_delete, solve_triangular

from sparsemor.core import FloatArray

DEPENDENT = 1e-11
"""Smallest relative distance of a column from the span of the active columns; columns closer to it
are not added."""


class Weights(NamedTuple):
    """Non-negative solution: values (n,) >= 0 and residual |A values - b|, computed from A and
    b."""

    values: FloatArray
    residual: float


def nonnegative(
    A: FloatArray, b: FloatArray, tolerance: float, most: int | None = None,
    start: FloatArray | None = None,
) -> Weights:
    """Sparse w >= 0 with |A w - b| <= tolerance; A (m, n), b (m,).

    most: largest number of nonzeros, n by default; start (n,) >= 0: weights whose nonzeros are the
    active set at first. Where the tolerance cannot be reached (no remaining column lowers the
    residual, or `most` columns are active), the last w is returned with its residual.
    """
    n = A.shape[1]
    most = n if most is None else most
    norms = np.linalg.norm(A, axis=0)
    # Q R: QR factors of the columns `active`, in this order; x: weights; r: residual b - A x
    active: list[int] = []
    Q, R = np.zeros((len(b), 0)), np.zeros((0, 0))
    x, r, size = np.zeros(n), b, float(np.linalg.norm(b))
    zero, stalled = norms == 0.0, np.zeros(n, dtype=np.bool_)
    if start is not None and start.any():
        active = [int(j) for j in np.flatnonzero(start)]
        Q, R = np.linalg.qr(A[:, active])
        Q, R, active, x = _feasible(Q, R, active, b, start)
        r = b - Q @ (Q.T @ b)
        size = float(np.linalg.norm(r))
    for _ in range(10 * n):
        if size <= tolerance or len(active) >= most:
            break
        gain = A.T @ r  # descent of |A w - b|^2 / 2 per unit of each weight
        gain[active] = -np.inf
        gain[zero | stalled] = -np.inf
        entering = _entering(A, norms, Q, R, b, gain)
        if entering is None:
            break
        j, q, R_new = entering
        Q, R, active = np.column_stack([Q, q]), R_new, [*active, j]
        Q, R, active, x = _feasible(Q, R, active, b, x)
        r = b - Q @ (Q.T @ b)
        before, size = size, float(np.linalg.norm(r))
        if size < before * (1.0 - 1e-10):
            stalled[:] = False
        else:
            stalled[j] = True  # rounding only: not again before another one has helped
    return Weights(x, float(np.linalg.norm(A @ x - b)))


def _entering(
    A: FloatArray, norms: FloatArray, Q: FloatArray, R: FloatArray, b: FloatArray,
    gain: FloatArray,
) -> tuple[int, FloatArray, FloatArray] | None:
    """Column of largest gain that is linearly independent of the active ones and would get a
    positive weight, with the new column of Q and the new R; None when no column lowers the
    residual. Writes to `gain` (n,), -inf for columns that are not to be tried. norms (n,): lengths
    of the columns of A; Q (m, k), R (k, k): QR factors of the active ones."""
    while True:
        j = int(np.argmax(gain))
        if not gain[j] > 0.0:
            return None
        q, grown = _appended(Q, R, A[:, j])
        # R_kk is the distance from the active columns, q . b / R_kk the new weight
        if grown[-1, -1] > DEPENDENT * norms[j] and q @ b > 0.0:
            return j, q, grown
        gain[j] = -np.inf


def _appended(Q: FloatArray, R: FloatArray, a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """New orthonormal column of Q for a column a (m,), and R extended by it; Gram-Schmidt is
    applied twice against round-off."""
    h = Q.T @ a
    q = a - Q @ h
    again = Q.T @ q
    q = q - Q @ again
    size = float(np.linalg.norm(q))
    k = len(R)
    grown = np.zeros((k + 1, k + 1))
    grown[:k, :k], grown[:k, k], grown[k, k] = R, h + again, size
    return q / size if size > 0.0 else q, grown


def _feasible(
    Q: FloatArray, R: FloatArray, active: list[int], b: FloatArray, x: FloatArray
) -> tuple[FloatArray, FloatArray, list[int], FloatArray]:
    """Least squares on the active columns from feasible weights x (n,); columns whose weights
    become nonpositive leave the active set. Returns Q, R, the active columns and the weights (n,).
    Q R: QR factors of the columns `active`, in their order."""
    w = x[active]
    while active:
        z = solve_triangular(R, Q.T @ b)
        negative = z <= 0.0
        if not negative.any():
            w = z
            break
        # from feasible w towards the minimiser z, up to the first weight that becomes zero
        step = float((w[negative] / (w[negative] - z[negative])).min())
        w = w + step * (z - w)
        out = negative & (w <= 1e-14 * w.max())
        if not out.any():  # rounding left none at zero: the smallest leaves
            out[np.flatnonzero(negative)[np.argmin(w[negative])]] = True
        for i in np.flatnonzero(out)[::-1]:  # from the last, so that numbers stay valid
            Q, R = qr_delete(Q, R, i, 1, "col", check_finite=False)
            Q, R = Q[:, : R.shape[1]], R[: R.shape[1]]
        active = [j for j, gone in zip(active, out, strict=True) if not gone]
        w = w[~out]
    found = np.zeros_like(x)
    found[active] = w
    return Q, R, active, found
