"""Groups, free columns and the reduced problem of sparse recovery, and statuses that are true."""

import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from recovery import PURSUITS, SOLVERS, Tempting, each, each_linear, empty
from sparsemor.core import Group, SparseOutcome, SparseProblem, SparseSolver, SparseStart
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.core.registry import installed as extras
from sparsemor.core.status import Status
from sparsemor.core.testing import check_sparse_solver
from sparsemor.core.testing.sparse_problems import (
    Elsewhere,
    LeastSquares,
    all_penalised,
    chained,
    incoherent,
    tall,
)
from sparsemor.plugins.sparse_solvers.basis_pursuit import BasisPursuit, BasisPursuitLp
from sparsemor.plugins.sparse_solvers.cosamp import Cosamp
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton
from sparsemor.plugins.sparse_solvers.lasso_lars import LassoLars
from sparsemor.plugins.sparse_solvers.newton_on_supports import LinearRecovery
from sparsemor.plugins.sparse_solvers.omp import OrthogonalMatchingPursuit

# ------------------------------------------------------------------- columns given twice


@pytest.mark.parametrize("solver", [
    Cosamp(), LassoLars(), OrthogonalMatchingPursuit(), BasisPursuitLp(), GreedyGaussNewton(),
    GreedyGaussNewton(candidates="correlated")], ids=lambda s: type(s).__name__)
def test_columns_given_twice_do_not_spend_the_budget(solver: SparseSolver) -> None:
    """Right value by construction: b = J x with four nonzeros. Each column is there three times,
    once with the other sign; least squares splits a coefficient among the copies, and pruning drops
    what then looks small."""
    for seed, noise in ((0, 0.0), (1, 1e-10)):
        rng = np.random.default_rng(seed)
        A = np.linalg.qr(rng.standard_normal((40, 12)))[0] + 0.03 * rng.standard_normal((40, 12))
        J = np.concatenate([A, -A, A], axis=1)
        J += noise * rng.standard_normal(J.shape)
        J /= np.linalg.norm(J, axis=0)
        x = np.zeros(36)
        x[rng.choice(12, 4, replace=False)] = np.array([1.0, -0.5, 0.7, -0.3])
        columns = ColumnSubsets(np.ascontiguousarray(J), 1e-10)
        none = np.zeros(36, dtype=np.bool_)
        found = solver.prepare(columns, 4).select(-J @ x, np.zeros(36), none)
        assert found.status is Status.DONE
        assert np.array_equal(np.flatnonzero(found.support) % 12, np.flatnonzero(x)), seed
        left = columns.squared_residual(found.support, J @ x)
        assert left is not None and left < 1e-16


@pytest.mark.parametrize("sizes", [(3, 3), (2, 4), (4, 4)])
@pytest.mark.parametrize("candidates", ["all", "correlated"])
def test_as_many_rows_as_active_columns(sizes: tuple[int, int], candidates: str) -> None:
    """No row is left for another column: the support stays, and is one that fits."""
    m, budget = sizes
    solver = GreedyGaussNewton.model_validate({"candidates": candidates})
    J = np.linalg.qr(np.random.default_rng(0).standard_normal((6, 6)))[0][:m]
    J = J / np.linalg.norm(J, axis=0)
    start = np.arange(6) < m
    recovery = solver.prepare(ColumnSubsets(np.ascontiguousarray(J), 1e-10), budget)
    c = np.where(start, 1.0, 0.0)
    found = recovery.select(1e-3 * np.ones(m), c, start)
    assert found.status is Status.DONE and np.count_nonzero(found.support) <= budget


# ------------------------------------------------------------------- groups and the reduced problem


@pytest.mark.full
@each
def test_the_answer_is_least_squares_on_its_support(solver: SparseSolver) -> None:
    rng = np.random.default_rng(7)
    problem, noise = tall(rng), 0.1 * rng.standard_normal(60)
    noisy = Elsewhere(problem, lambda r: r + noise)
    outcome = empty(solver, noisy)
    assert outcome.status is Status.DONE
    assert outcome.support[:4].all() and outcome.residual_norm > 0.1
    A = problem.A[:, outcome.support]
    slope = A.T @ noisy.residual(outcome.c) / np.linalg.norm(A, axis=0)
    assert np.abs(slope).max() < 1e-12


@each
def test_what_free_columns_explain_activates_nothing_else(solver: SparseSolver) -> None:
    problem = incoherent(np.random.default_rng(8))
    answer = np.where(np.arange(74) < 4, problem.answer, 0.0)
    outcome = empty(solver, replace(problem, answer=answer))
    assert outcome.status is Status.DONE
    assert outcome.residual_norm < 1e-13
    np.testing.assert_allclose(outcome.c, answer, atol=1e-12)


@each_linear
def test_a_budget_of_zero_closes_a_group(solver: SparseSolver) -> None:
    problem = incoherent(np.random.default_rng(9))
    free, first, second = problem.groups
    answer = np.where(np.arange(74) < 44, problem.answer, 0.0)
    closed = replace(problem, answer=answer, groups=(free, first, replace(second, budget=0)))
    outcome = empty(solver, closed)
    assert outcome.status is Status.DONE and not outcome.support[44:].any()
    np.testing.assert_allclose(outcome.c, answer, atol=1e-10)


# ------------------------------------------------------------------- statuses and refusals


@pytest.mark.parametrize(("solver", "options"), PURSUITS.values(), ids=list(PURSUITS))
def test_equations_that_contradict_each_other_are_infeasible(
    solver: type[LinearRecovery], options: dict[str, Any]
) -> None:
    problem = all_penalised(np.random.default_rng(12))
    A = problem.A.copy()
    A[1] = A[0]
    apart = np.zeros(60)
    apart[1] = 0.5
    torn = Elsewhere(replace(problem, A=A), lambda r: r + apart)
    assert empty(solver(**options), torn).status is Status.INFEASIBLE
    fitted = empty(OrthogonalMatchingPursuit(), torn)
    assert fitted.status is Status.DONE and fitted.residual_norm > 0.3


@pytest.mark.parametrize(("solver", "options"), PURSUITS.values(), ids=list(PURSUITS))
def test_exact_equations_are_refused_where_there_are_more_of_them_than_columns(
    solver: type[LinearRecovery], options: dict[str, Any]
) -> None:
    problem = tall(np.random.default_rng(13))
    with pytest.raises(InputError, match="overdetermined: more rows than"):
        empty(solver(**options), problem)


class Careless(OrthogonalMatchingPursuit):
    """Declares less than it can, and takes everything."""

    lacks: frozenset[str]

    @property
    def capabilities(self) -> frozenset[str]:
        return super().capabilities - self.lacks

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        return OrthogonalMatchingPursuit().solve(problem, start)


@pytest.mark.parametrize("lacks", ["nonlinear", "unpenalised", "overdetermined",
                                   "underdetermined"])
def test_the_law_finds_a_solver_that_takes_what_it_should_refuse(lacks: str) -> None:
    with pytest.raises(AssertionError, match=f"lacks {lacks}, yet took the problem"):
        check_sparse_solver(Careless(lacks=frozenset({lacks})), trials=1)


@each_linear
def test_too_few_linearisations_are_not_called_converged(solver: SparseSolver) -> None:
    problem = incoherent(np.random.default_rng(14))
    short = solver.model_copy(update={"max_iterations": 1})
    outcome = empty(short, problem)
    assert outcome.status is Status.NOT_CONVERGED and outcome.iterations == 1
    norm = float(np.linalg.norm(problem.residual(outcome.c)))
    assert outcome.residual_norm == pytest.approx(norm, abs=1e-12)


def test_too_few_sweeps_are_not_called_converged() -> None:
    problem = chained(np.random.default_rng(0), 60, 150, 8, 0.9)
    assert empty(Cosamp(sweeps=1), problem).status is Status.NOT_CONVERGED
    assert empty(Cosamp(), problem).status is Status.DONE


@each
def test_overflow_is_a_status(solver: SparseSolver) -> None:
    huge = Elsewhere(incoherent(np.random.default_rng(0)), lambda r: r * 1e308 * 1e10)
    assert empty(solver, huge).status is Status.NOT_FINITE


@each
def test_fewer_rows_than_unpenalised_columns_are_rank_deficient(solver: SparseSolver) -> None:
    A = np.random.default_rng(0).standard_normal((3, 5))
    problem = LeastSquares((Group("free", 0, 5, None),), A, np.zeros((3, 5)), 0.0, np.ones(5))
    assert empty(solver, problem).status is Status.RANK_DEFICIENT


@each
def test_of_two_equal_atoms_at_most_one_is_taken(solver: SparseSolver) -> None:
    """Twins may share a coefficient evenly: halves of the least one displace no other atom."""
    problem = incoherent(np.random.default_rng(15))
    scaled = np.abs(problem.answer * np.linalg.norm(problem.A, axis=0))[4:44]
    one = int(np.argmin(np.where(scaled > 0.0, scaled, np.inf))) + 4
    twin = int(np.flatnonzero(problem.answer[4:44] == 0.0)[0]) + 4
    A = problem.A.copy()
    A[:, twin] = A[:, one]
    outcome = empty(solver, replace(problem, A=A))
    assert outcome.status is Status.DONE and outcome.residual_norm < 1e-10
    assert int(outcome.support[[one, twin]].sum()) == 1


@each
def test_atoms_no_row_sees_are_left_out(solver: SparseSolver) -> None:
    problem = incoherent(np.random.default_rng(16))
    dark = np.flatnonzero(problem.answer[4:44] == 0.0)[:2] + 4
    A = problem.A.copy()
    A[:, dark] = 0.0
    outcome = empty(solver, replace(problem, A=A))
    assert outcome.status is Status.DONE and not outcome.support[dark].any()
    np.testing.assert_allclose(outcome.c, problem.answer, atol=1e-10)


@pytest.mark.parametrize("name", ["greedy_gauss_newton", "omp", "cosamp", "lasso_lars"])
def test_a_cycle_of_supports_ends_on_the_better_one(name: str) -> None:
    outcome = empty(SOLVERS[name], Tempting())
    assert outcome.status is Status.DONE and outcome.iterations < 10
    np.testing.assert_allclose(outcome.c, [0.0, 1.2])
    assert outcome.residual_norm == pytest.approx(np.sqrt(2.0))


# ------------------------------------------------------------------- optional packages


@pytest.mark.parametrize(("plugin", "extra"), [(BasisPursuit, "cvx"), (LassoLars, "lars")])
def test_a_missing_package_is_named_with_its_extra(
    plugin: type[LinearRecovery], extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda module: None)
    with pytest.raises(ValidationError, match=rf"not installed: pip install 'sparsemor\[{extra}\]"):
        plugin()


@pytest.mark.full
def test_optional_packages_are_imported_when_used_only() -> None:
    script = (
        "import sys\n"
        "from sparsemor.core.testing import installed\n"
        "solvers = [plugin() for plugin in installed('sparse_solver').values()]\n"
        "print(len(solvers), sorted({'cvxpy', 'sklearn'} & set(sys.modules)))\n")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == f"{len(SOLVERS)} []", done.stderr


def test_a_solver_of_cvxpy_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValidationError, match="no solver NOBODY here; it has .*CLARABEL"):
        BasisPursuit(solver="NOBODY")


def test_a_cone_is_not_given_to_a_solver_without_cones() -> None:
    with pytest.raises(ValidationError, match="OSQP takes no cone: choose norm: largest"):
        BasisPursuit(solver="OSQP")
    assert empty(BasisPursuit(solver="OSQP", norm="largest"),
                 all_penalised(np.random.default_rng(0))).status is Status.DONE
