"""Recovery, statuses and cycles of the greedy sparse solver; what its law kit catches."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from recovery import Tempting
from sparsemor.core import (
    Columns,
    Group,
    Recovery,
    Selection,
    SparseOutcome,
    SparseProblem,
    SparseStart,
)
from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.status import Status
from sparsemor.core.testing import check_sparse_solver
from sparsemor.core.testing.sparse_problems import LeastSquares, empty_start, incoherent
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton


def imitated() -> LeastSquares:
    """The answer is column 0 alone, and columns 1 to 5 together look almost like it."""
    A = np.random.default_rng(5).standard_normal((40, 12))
    A[:, 0] = A[:, 1:6].sum(axis=1) + 1e-3 * A[:, 0]
    answer = np.zeros(12)
    answer[0] = 1.0
    return LeastSquares((Group("u", 0, 12, 5),), A, np.zeros_like(A), 0.0, answer)


@pytest.mark.full
def test_an_imitated_atom_is_found_when_all_may_enter() -> None:
    problem = imitated()
    start = np.zeros(12, dtype=np.bool_)
    start[1:6] = True
    outcome = GreedyGaussNewton(candidates="all").solve(problem, SparseStart(np.zeros(12), start))
    assert outcome.status is Status.DONE
    np.testing.assert_allclose(outcome.c, problem.answer, atol=1e-9)
    check_sparse_solver(GreedyGaussNewton(candidates="all"), trials=2)


def test_a_warm_start_on_the_right_support_takes_two_linearisations() -> None:
    problem = incoherent(np.random.default_rng(1))
    outcome = GreedyGaussNewton().solve(
        problem, SparseStart(np.zeros(74), problem.support)
    )
    assert outcome.iterations == 2
    assert np.array_equal(outcome.support, problem.support)


def test_atoms_at_round_off_do_not_keep_the_iteration_alive() -> None:
    """A dictionary with far more atoms than the answer has, as a completed POD basis is."""
    rng = np.random.default_rng(0)
    A = np.linalg.qr(rng.standard_normal((300, 300)))[0][:160]
    answer = np.zeros(300)
    answer[:30] = 10.0 ** -np.linspace(0.0, 10.0, 30)
    problem = LeastSquares((Group("g", 0, 300, 50),), A, np.zeros((160, 300)), 0.0, answer)
    outcome = GreedyGaussNewton().solve(problem, empty_start(300))
    assert outcome.status is Status.DONE
    again = GreedyGaussNewton().solve(problem, SparseStart(outcome.c, outcome.support))
    assert again.status is Status.DONE and again.iterations == 1
    assert np.array_equal(again.support, outcome.support)


def test_a_cycle_cut_short_gives_the_best_iterate_met() -> None:
    outcome = GreedyGaussNewton(max_iterations=3).solve(Tempting(), empty_start(2))
    assert outcome.status is Status.NOT_CONVERGED
    norm = float(np.linalg.norm(Tempting().residual(outcome.c)))
    assert outcome.residual_norm == pytest.approx(norm)
    assert norm < np.linalg.norm([1.0, 1.2, 1.0])


class Broken(GreedyGaussNewton):
    fault: str

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        good = super().solve(problem, start)
        if self.fault == "over budget":
            return replace(good, support=np.ones_like(good.support))
        if self.fault == "outside support":
            return replace(good, c=np.where(good.support, good.c, 1e-9))
        if self.fault == "false norm":
            return replace(good, residual_norm=good.residual_norm + 1.0)
        if self.fault == "hides failure":
            return replace(good, status=Status.DONE)
        if self.fault == "writes":
            start.c[0] += 1.0
        if self.fault == "gives up":
            return replace(good, c=np.zeros_like(good.c))
        return good

    def prepare(self, columns: Columns, budget: int) -> Recovery:
        return BrokenRecovery(super().prepare(columns, budget), columns, budget, self.fault)


@dataclass
class BrokenRecovery:
    inner: Recovery
    columns: Columns
    budget: int
    fault: str
    calls: int = 0

    def select(self, r: FloatArray, c: FloatArray, support: BoolArray) -> Selection:
        good, k = self.inner.select(r, c, support), len(c)
        self.calls += 1
        if self.fault == "selects too many":
            return Selection(np.ones(k, dtype=np.bool_))
        if self.fault == "selects the first ones":
            return Selection(np.arange(k) < self.budget)
        if self.fault == "remembers":
            return Selection(np.arange(k) == self.calls)
        if self.fault == "writes to c":
            c += 1.0
        if self.fault == "leaves its solution" and good.support[support].all() and support.any():
            return Selection(np.roll(good.support, 1)) if support.sum() == self.budget else good
        if self.fault == "selects twins":
            size = np.abs(np.linalg.pinv(self.columns.A) @ (self.columns.A @ c - r))
            kept = np.zeros(k, dtype=np.bool_)
            kept[np.argsort(-size)[: self.budget]] = True
            return Selection(kept, good.status)
        return Selection(good.support) if self.fault == "hides nan" else good


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("over budget", "active atoms"),
        ("outside support", "not zero outside"),
        ("false norm", "residual_norm"),
        ("hides failure", "residual of nan"),
        ("writes", "wrote to its start"),
        ("gives up", "residual_norm|has a relative error"),
        ("selects too many", "active atoms, budget 5"),
        ("selects the first ones", "of the answer are not selected"),
        ("remembers", "two selections differ"),
        ("writes to c", "select wrote to its arguments"),
        ("leaves its solution", "a support is left at its own solution"),
        ("selects twins", "linearly dependent columns are selected|not selected"),
        ("hides nan", "residual of nan"),
    ],
)
def test_a_broken_sparse_solver_fails_its_law(fault: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_sparse_solver(Broken(fault=fault), trials=2)
