"""S-optimal selection of rows: nearly orthogonal sampled columns and a large determinant."""

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.plugins.samplers.candidate_rows import GreedyRows, SpanSampler
from sparsemor.plugins.samplers.smallest_singular_pair import LOST, RowFactor

TINY = 1e-300
"""Lower bound of squares before logarithms are taken, below every nonzero square."""


class SOpt(SpanSampler):
    """S-optimality: greedy rows of largest S = (sqrt det A^T A / prod |a_j|)^(1/k), A the sample.

    A (m, k) are the sampled rows, a_j its columns. S is 1 for orthogonal columns and 0 for
    dependent ones. Shin and Xiu 2016, SIAM J. Sci. Comput. 38, A385; for reduced models: Lauzon et
    al. 2024, doi 10.1137/22M1484018 (S-OPT). Deterministic: the seed has no effect.
    """

    def choose(self, U: FloatArray, rows: GreedyRows, rng: np.random.Generator) -> None:
        one_column_a_row(U, rows)
        all_columns(U, rows)


def one_column_a_row(U: FloatArray, rows: GreedyRows) -> None:
    """Adds rows of U (n, k) while there are fewer rows than columns: p rows are compared by the
    first p columns, a row by the S = (sqrt det A^T A / prod |a_j|)^(1/p) of the sample A with it
    added.

    With one row missing, det A^T A after row u is added is a constant times (u N)^2, N the null
    vector of the rows taken; with more missing, the norm of u in their null space is used.
    """
    k = U.shape[1]
    factor = RowFactor(U[rows.taken])
    while rows.left:
        count = int(rows.taken.sum())
        j = min(count + 1, k)
        _, V, rank = factor.singular(j)  # columns of V from `rank` on: null space of the rows taken
        if rank == j:
            return
        C = U[:, :j]
        hidden = C @ V[:, rank:]
        gain = np.einsum("ij,ij->i", hidden, hidden)
        # log det A^T A - log prod |a_j|^2 but for a constant, of all candidates (n,); the first row
        # always makes S = 1: there the largest entry is taken
        cost = _log_norms(C, C[rows.taken]) if count else 0.0
        factor.add(U[rows.take(np.log(np.maximum(gain, TINY)) - cost)])


def all_columns(U: FloatArray, rows: GreedyRows) -> None:
    """Adds further rows of U (n, k) by det(A^T A + u^T u) = det(A^T A) (1 + u (A^T A)^-1 u^T) for a
    row u: the one of largest det A^T A / prod |a_j|^2 over the columns a_j of the sample A, with it
    added.

    q (n,), u (A^T A)^-1 u^T of all candidates, is updated after each row by rank-one updates, and
    computed again where these have lost digits.
    """
    if not rows.left:
        return
    factor, fresh = RowFactor(U[rows.taken]), True
    q = inverse = np.zeros(0)
    while rows.left:
        if fresh:
            s, V, _ = factor.singular(U.shape[1])
            half = V / s
            inverse, W = half @ half.T, U @ half
            q = np.einsum("ij,ij->i", W, W)
        taken = rows.take(np.log1p(q) - _log_norms(U, U[rows.taken]))
        factor.add(U[taken])
        shrunk = 1.0
        for i in taken:
            b = inverse @ U[i]
            size = 1.0 + float(U[i] @ b)
            q = np.maximum(q - (U @ b) ** 2 / size, 0.0)
            inverse = inverse - np.outer(b, b) / size
            shrunk *= size
        fresh = shrunk > LOST


def _log_norms(C: FloatArray, A: FloatArray) -> FloatArray:
    """Sums (n,) over the columns of log |a_j|^2, after each row of C (n, j) is appended to A (p,
    j)."""
    squares = np.einsum("ij,ij->j", A, A) + C * C
    return np.asarray(np.log(np.maximum(squares, TINY)).sum(axis=1))
