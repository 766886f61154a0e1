"""Linearised problem after elimination of its unpenalised columns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from sparsemor.core import BoolArray, FloatArray, Group, IntArray
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.plugins.sparse_solvers.supports import EPS, Linearised, always_active

DEPENDENT = 1e-10
"""Norm of a unit column's part outside the span of other columns, at or below which it counts as
dependent."""
PARALLEL = 1e-7
"""Sine of the angle between two columns, at or below which they count as the same one."""


@dataclass(frozen=True, slots=True, eq=False)
class Penalised:
    """Linear problem whose columns are all penalised: sparse x (k,) with A x = b, A (m, k), b (m,).

    Every group has a budget, its largest number of active columns. The unpenalised columns J_f = Q
    [R; 0] are eliminated: A, b are the rows of Q^T J and Q^T (J z - r) below R, so that for every x
    the unpenalised unknowns satisfy the rows above exactly. Where more rows than columns are left,
    A = Q [R; 0] is reduced once more: R x = Q^T b is the best fit of all columns, and the rest of b
    is independent of x. Neither changes a correlation, nor which x fits better. Columns keep the
    scale of `Linearised`, unit length before the elimination: the part of a column that unpenalised
    ones explain has no weight. A column of zeros, one that depends on the unpenalised ones, one
    parallel to an earlier column, and one whose group has budget 0, is zero.
    """

    A: FloatArray
    b: FloatArray
    groups: tuple[Group, ...]
    columns: IntArray
    """Positions (k,) of the columns in the whole problem."""
    subsets: ColumnSubsets
    """Factors of subsets of the columns of A, kept for all right-hand sides with this A."""

    @classmethod
    def from_linearised(cls, linear: Linearised, groups: Sequence[Group]) -> "Penalised":
        """Penalised part of a linearised problem r + J (z_new - z), with unit columns J, residual r
        and scaled coefficients z; its unpenalised columns must be independent."""
        free = always_active(groups, linear.z.size)
        columns = np.flatnonzero(~free)
        target = linear.J @ linear.z - linear.r  # right-hand side for coefficients, not for a step
        wide = np.column_stack((linear.J[:, columns], target))
        f = int(np.count_nonzero(free))
        if f:
            reflectors, tau, _, _ = lapack.dgeqrf(linear.J[:, free])
            # rows of Q^T [J, target] below the f rows of R; -1: ask for the workspace size
            size = int(lapack.dormqr("L", "T", reflectors, tau, wide, -1)[1][0])
            wide = lapack.dormqr("L", "T", reflectors, tau, wide, size)[0][f:]
        A, b = wide[:, :-1].copy(), wide[:, -1].copy()
        A[:, np.linalg.norm(A, axis=0) <= DEPENDENT] = 0.0
        if np.linalg.norm(b) <= 100.0 * EPS * np.linalg.norm(target):
            b[:] = 0.0  # the free columns explain all but rounding
        kept, start = [], 0
        for g in groups:
            if g.budget is not None:
                kept.append(Group(g.name, start, start + g.stop - g.start, g.budget))
                start = kept[-1].stop
                if g.budget == 0:
                    A[:, kept[-1].start : start] = 0.0
        A[:, repeated(A)] = 0.0
        if A.shape[0] > A.shape[1]:
            Q, A = _best_fit(A)
            b = b @ Q
        return cls(A, b, tuple(kept), columns, ColumnSubsets(A, DEPENDENT))

    def with_right(self, b: FloatArray) -> "Penalised":
        """The same columns for another right-hand side b (m,)."""
        return replace(self, b=b)

    @property
    def size(self) -> int:
        return int(self.b.size)

    @property
    def budgets(self) -> IntArray:
        """Budget (k,) of each column's group."""
        counts = [(g.budget or 0, g.stop - g.start) for g in self.groups]
        return np.repeat([n for n, _ in counts], [w for _, w in counts]).astype(np.int64)

    def least_squares(self, active: BoolArray) -> FloatArray:
        """Least-squares solution x (k,) on the active columns; of least norm where it is not
        unique."""
        return self.subsets.least_norm_solution(active, self.b)

    def left(self, x: FloatArray) -> float:
        """Norm of the residual b - A x."""
        return float(np.linalg.norm(self.b - self.A @ x))


def repeated(A: FloatArray) -> BoolArray:
    """Mask (k,) of the columns of A (m, k) that are parallel to an earlier one.

    Two of them can share a coefficient in any way: least squares splits it, so that each looks
    small against other columns, and a budget is spent on both. Parallel columns have equal products
    with any vector but for their length and sign; only neighbours among sorted products are
    compared, in O(m k) operations.
    """
    lengths = np.sqrt((A * A).sum(axis=0))
    found = np.zeros(A.shape[1], dtype=np.bool_)
    used = np.flatnonzero(lengths > 0.0)
    U = A[:, used] / lengths[used]
    product = np.abs(np.random.default_rng(0).standard_normal(len(A)) @ U)
    order = product.argsort(kind="stable")
    # products of parallel columns differ by at most PARALLEL times the length of the random vector
    reach = 10.0 * PARALLEL * np.sqrt(len(A))
    for place, i in enumerate(order):
        for j in order[place + 1:]:
            if product[j] - product[i] > reach:
                break
            cosine = U[:, i].dot(U[:, j])
            if np.linalg.norm(U[:, j] - cosine * U[:, i]) <= PARALLEL:
                found[used[max(i, j)]] = True
    return found


def _best_fit(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis Q (m, r) of the columns of A (m, k), and Q^T A: the least-squares solutions
    of A x = b are those of Q^T A x = Q^T b, which has as many rows as A independent columns."""
    Q, R, order = linalg.qr(A, mode="economic", pivoting=True, check_finite=False)
    rank = int(np.count_nonzero(np.abs(np.diag(R)) > DEPENDENT))
    fitted = np.zeros((rank, A.shape[1]))
    fitted[:, order] = R[:rank]
    return Q[:, :rank], fitted


@dataclass(frozen=True, slots=True, eq=False)
class PreparedColumns:
    """Constant columns J (m, k) of one group, of unit length or zero, reduced once to as many rows
    as they have independent columns. turn: orthonormal basis Q (m, r) of their space, by which J
    and b become Q^T J and Q^T b; None where m <= k and all rows are kept."""

    problem: Penalised
    turn: FloatArray | None

    @classmethod
    def from_matrix(cls, J: FloatArray, budget: int) -> "PreparedColumns":
        J = np.array(J)
        J[:, repeated(J)] = 0.0
        turn, A = (None, J) if J.shape[0] <= J.shape[1] else _best_fit(J)
        k = J.shape[1]
        return cls(Penalised(A, np.zeros(len(A)), (Group("", 0, k, budget),), np.arange(k),
                             ColumnSubsets(A, DEPENDENT)), turn)

    def with_right(self, b: FloatArray) -> Penalised:
        """Problem J x = b (m,)."""
        return self.problem.with_right(b if self.turn is None else b.dot(self.turn))


def weights(problem: Penalised) -> FloatArray:
    """Weights (k,) of the l1 norm: 1 / budget of the column's group (Liang et al. 2026, Eq. 25)."""
    return np.asarray(1.0 / np.maximum(problem.budgets, 1))
