"""Sparse problems with known solutions, for tests of sparse solvers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.protocols.sparse_solver import Group, SparseStart


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquares:
    """Sparse least-squares problem: residual(c) = A c - b + bend * (B c)^2, linear for bend = 0,
    with the solution `answer`.

    A, B (m, k); answer (k,), sparse in every group that has a budget (largest number of active
    columns).
    """

    groups: tuple[Group, ...]
    A: FloatArray
    B: FloatArray
    bend: float
    answer: FloatArray

    @property
    def needs(self) -> frozenset[str]:
        """Capabilities that a solver needs for this problem: names of
        `core.protocols.sparse_solver`."""
        m, k = self.A.shape
        features = {
            "nonlinear": self.bend != 0.0,
            "unpenalised": any(g.budget is None for g in self.groups),
            "overdetermined": m > k,
            "underdetermined": m < k,
        }
        return frozenset(name for name, needed in features.items() if needed)

    def residual(self, c: FloatArray) -> FloatArray:
        return np.asarray(self._left(c) - self._left(self.answer))

    def jacobian(self, c: FloatArray) -> FloatArray:
        return np.asarray(self.A + 2.0 * self.bend * (self.B @ c)[:, None] * self.B)

    def _left(self, c: FloatArray) -> FloatArray:
        return np.asarray(self.A @ c + self.bend * (self.B @ c) ** 2)

    @property
    def support(self) -> BoolArray:
        """Mask (k,): True where the solution is not zero, and for all columns of unpenalised
        groups."""
        mask = np.asarray(self.answer != 0.0)
        for g in self.groups:
            if g.budget is None:
                mask[g.start : g.stop] = True
        return mask


@dataclass(frozen=True, slots=True, eq=False)
class Elsewhere:
    """Sparse problem with the residual of another problem, changed by the function `change`."""

    inner: LeastSquares
    change: Callable[[FloatArray], FloatArray]

    @property
    def needs(self) -> frozenset[str]:
        return self.inner.needs

    @property
    def groups(self) -> tuple[Group, ...]:
        return self.inner.groups

    def residual(self, c: FloatArray) -> FloatArray:
        return self.change(self.inner.residual(c))

    def jacobian(self, c: FloatArray) -> FloatArray:
        return self.inner.jacobian(c)


def incoherent(rng: np.random.Generator, bend: float = 0.0) -> LeastSquares:
    """Random problem with two groups of Gaussian columns, 3 of 40 and 2 of 30 active, 4 unpenalised
    columns, and 60 rows.

    Norms of columns differ by up to a factor 100, like those of unknowns of different units.
    Problems are drawn until `exact_recovery` < 1: a solution that is not found is then a fault of
    the solver.
    """
    return _inside(rng, 60, 4, ((40, 3), (30, 2)), bend)


def tall(rng: np.random.Generator, bend: float = 0.0) -> LeastSquares:
    """Random problem like `incoherent` with more rows than columns: 3 of 20 and 2 of 12 active, 4
    unpenalised columns, 60 rows."""
    return _inside(rng, 60, 4, ((20, 3), (12, 2)), bend)


def all_penalised(rng: np.random.Generator, bend: float = 0.0) -> LeastSquares:
    """Random problem like `incoherent`, without unpenalised columns."""
    return _inside(rng, 60, 0, ((40, 3), (30, 2)), bend)


def exact_recovery(problem: LeastSquares) -> float:
    """Exact recovery coefficient: below 1, orthogonal matching pursuit and minimum l1 norms, with
    or without weights 1 / budget, find the solution of the linear problem from an empty support.

    max over wrong columns j of |pinv(A_S) a_j|_1, with unit columns a_j made orthogonal to the
    unpenalised columns, and S the penalised support (Tropp 2004, Theorem A, doi
    10.1109/TIT.2004.834793). For a norm with weights w: of sum_i w_i |pinv(A_S) a_j|_i / w_j.
    """
    A = problem.A / np.linalg.norm(problem.A, axis=0)
    free, weights = np.zeros(A.shape[1], dtype=np.bool_), np.ones(A.shape[1])
    for g in problem.groups:
        free[g.start : g.stop] = g.budget is None
        weights[g.start : g.stop] = 1.0 / max(g.budget or 1, 1)
    Q = np.linalg.qr(A[:, free])[0]
    A = A - Q @ (Q.T @ A)
    true, wrong = problem.support & ~free, ~problem.support & ~free
    S = A[:, true]
    shares = np.abs(np.linalg.solve(S.T @ S, S.T @ A[:, wrong]))  # Gaussian: well conditioned
    weighted = weights[true] @ shares / weights[wrong]
    return float(max(shares.sum(axis=0).max(), weighted.max()))


def _inside(
    rng: np.random.Generator, m: int, free: int, sizes: Sequence[tuple[int, int]], bend: float
) -> LeastSquares:
    while True:
        problem = _gaussian(rng, m, free, sizes, bend)
        if exact_recovery(problem) < 1.0:
            k = problem.answer.size
            lengths = np.linalg.norm(problem.A, axis=0)
            return replace(problem, B=rng.standard_normal((m, k)) * lengths / np.sqrt(m))


def _gaussian(
    rng: np.random.Generator, m: int, free: int, sizes: Sequence[tuple[int, int]], bend: float
) -> LeastSquares:
    """Random problem of m rows with Gaussian columns; free: number of unpenalised columns; sizes:
    number of columns and of active columns of each group with a budget; bend: factor of the
    nonlinear part (B c)^2, whose matrix B is zero here and drawn by the caller."""
    groups, stop = [Group("free", 0, free, None)] if free else [], free
    for name, (width, active) in zip(("first", "second"), sizes, strict=True):
        groups.append(Group(name, stop, stop + width, active))
        stop += width
    lengths = 10.0 ** rng.uniform(-1.0, 1.0, stop)
    A = rng.standard_normal((m, stop)) / np.sqrt(m) * lengths
    answer = np.zeros(stop)
    answer[:free] = rng.standard_normal(free)
    for g in groups:
        if g.budget is not None:
            chosen = rng.choice(np.arange(g.start, g.stop), g.budget, replace=False)
            answer[chosen] = rng.choice([-1.0, 1.0], g.budget) * rng.uniform(1.0, 2.0, g.budget)
    answer /= lengths
    return LeastSquares(tuple(groups), A, np.zeros_like(A), bend, answer)


def chained(
    rng: np.random.Generator, m: int = 200, k: int = 800, active: int = 40, coherence: float = 0.97
) -> LeastSquares:
    """Problem with one group of unit columns, each at the cosine `coherence` to the previous one;
    0: independent Gaussian columns.

    Columns further apart are less similar, so that from about 0.9 on this is the mutual coherence.
    Active entries have absolute values of 1 to 2 and random signs.
    """
    A = rng.standard_normal((m, k))
    A[:, 0] /= np.linalg.norm(A[:, 0])
    for j in range(1, k):
        last = A[:, j - 1]
        new = A[:, j] - (last @ A[:, j] if coherence else 0.0) * last
        A[:, j] = coherence * last + np.sqrt(1.0 - coherence**2) * new / np.linalg.norm(new)
    answer = np.zeros(k)
    chosen = rng.choice(k, active, replace=False)
    answer[chosen] = rng.choice([-1.0, 1.0], active) * rng.uniform(1.0, 2.0, active)
    return LeastSquares((Group("only", 0, k, active),), A, np.zeros((m, k)), 0.0, answer)


def one_group(rng: np.random.Generator, m: int = 60, k: int = 32, active: int = 5) -> LeastSquares:
    """Linear problem with one group of Gaussian unit columns, drawn until `exact_recovery` < 1."""
    while True:
        problem = chained(rng, m, k, active, 0.0)
        if exact_recovery(problem) < 1.0:
            return problem


def empty_start(k: int) -> SparseStart:
    return SparseStart(np.zeros(k), np.zeros(k, dtype=np.bool_))
