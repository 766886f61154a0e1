"""Recovery: true supports inside the theory, and agreement with peers."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import hadamard
from scipy.optimize import linprog

from recovery import PURSUITS, SOLVERS, each, empty
from sparsemor.core import Group, SparseSolver
from sparsemor.core.arrays import FloatArray
from sparsemor.core.status import Status
from sparsemor.core.testing import check_sparse_solver
from sparsemor.core.testing.sparse_problems import (
    LeastSquares,
    all_penalised,
    chained,
    incoherent,
)
from sparsemor.plugins.sparse_solvers.basis_pursuit import BasisPursuit, BasisPursuitLp
from sparsemor.plugins.sparse_solvers.lasso_lars import LassoLars
from sparsemor.plugins.sparse_solvers.newton_on_supports import LinearRecovery, Recovered
from sparsemor.plugins.sparse_solvers.penalised import Penalised
from sparsemor.plugins.sparse_solvers.supports import Linearised

VARIANTS: dict[str, tuple[type[SparseSolver], dict[str, Any]]] = {
    "lp, equations": (BasisPursuitLp, {"tolerance": 0.0}),
    "lp, interior point": (BasisPursuitLp, {"method": "highs-ipm"}),
    "cvxpy, equations": (BasisPursuit, {"tolerance": 0.0}),
    "cvxpy, SCIPY": (BasisPursuit, {"solver": "SCIPY", "norm": "largest"}),
    "lars, at a penalty": (LassoLars, {"penalty": 0.05}),
}
"""Classes and options: to name a solver of cvxpy imports cvxpy, which takes a second."""


# ------------------------------------------------------------------- inside and outside the theory


def two_bases(rng: np.random.Generator, active: int) -> LeastSquares:
    """64 spikes and 64 Hadamard vectors, mutual coherence 1/8: every support of less than
    (1 + 8)/2 columns is found by OMP and by basis pursuit (Tropp 2004, Theorem B)."""
    A = np.hstack((np.eye(64), hadamard(64) / 8.0))
    answer = np.zeros(128)
    answer[rng.choice(128, active, replace=False)] = (
        rng.choice([-1.0, 1.0], active) * 10.0 ** rng.uniform(-1.0, 1.0, active))
    return LeastSquares((Group("only", 0, 128, active),), A, np.zeros((64, 128)), 0.0, answer)


@each
def test_supports_within_the_coherence_bound_are_found(solver: SparseSolver) -> None:
    @settings(max_examples=4)
    @given(seed=st.integers(0, 2**32 - 1), active=st.integers(1, 4))
    def found(seed: int, active: int) -> None:
        problem = two_bases(np.random.default_rng(seed), active)
        outcome = empty(solver, problem)
        assert outcome.status is Status.DONE
        assert np.array_equal(outcome.support, problem.support)
        np.testing.assert_allclose(outcome.c, problem.answer, atol=1e-12)

    found()


@pytest.mark.full
@pytest.mark.parametrize(("solver", "options"), VARIANTS.values(), ids=list(VARIANTS))
def test_options_keep_the_laws(solver: type[SparseSolver], options: dict[str, Any]) -> None:
    check_sparse_solver(solver(**options), trials=1)


@pytest.mark.parametrize("name", ["basis_pursuit_lp", "lasso_lars"])
def test_an_l1_norm_tells_nearly_parallel_columns_apart_where_correlation_does_not(
    name: str
) -> None:
    problem = chained(np.random.default_rng(0), 60, 150, 8, 0.97)
    cosines = np.abs(problem.A.T @ problem.A) - np.eye(150)
    assert cosines.max() == pytest.approx(0.97, abs=1e-12)
    assert np.array_equal(empty(SOLVERS[name], problem).support, problem.support)
    assert not np.array_equal(empty(SOLVERS["omp"], problem).support, problem.support)


# ------------------------------------------------------------------- peers


def direct_lp(problem: LeastSquares, b: FloatArray, tolerance: float = 0.0) -> FloatArray:
    """min sum t_j / budget_j over (c, t) with -t <= c <= t and |A c - b| <= tolerance max|b|;
    c in the scale of unit columns, free ones without cost."""
    A = problem.A / np.linalg.norm(problem.A, axis=0)
    m, k = A.shape
    cost = np.zeros(2 * k)
    for g in problem.groups:
        if g.budget is not None:
            cost[k + g.start : k + g.stop] = 1.0 / g.budget
    one, none, slack = np.eye(k), np.zeros((m, k)), tolerance * np.abs(b).max()
    found = linprog(
        cost, A_ub=np.block([[one, -one], [-one, -one], [A, none], [-A, none]]),
        b_ub=np.concatenate((np.zeros(2 * k), b + slack, slack - b)),
        bounds=[(None, None)] * k + [(0.0, None)] * k, method="highs-ipm")
    assert found.status == 0
    return np.asarray(found.x[:k])


def recovered(solver: LinearRecovery, problem: LeastSquares, b: FloatArray) -> Recovered:
    """What the method itself finds for A c = b, before pruning and debiasing."""
    k = problem.A.shape[1]
    linear = Linearised.at(np.zeros(k), -b, problem.A)
    return solver.recover(Penalised.from_linearised(linear, problem.groups))


@pytest.mark.parametrize(("solver", "options"), PURSUITS.values(), ids=list(PURSUITS))
@pytest.mark.full
@pytest.mark.parametrize("make", [incoherent, all_penalised])
def test_basis_pursuit_agrees_with_a_direct_linear_program(
    solver: type[LinearRecovery], options: dict[str, Any],
    make: Callable[[np.random.Generator], LeastSquares]
) -> None:
    """For a right-hand side without any sparse answer, with and without free columns."""
    rng = np.random.default_rng(0)
    problem = make(rng)
    b = rng.standard_normal(60)
    free = sum(g.stop - g.start for g in problem.groups if g.budget is None)
    found = recovered(solver(**options), problem, b)
    assert found.status is Status.DONE
    np.testing.assert_allclose(found.x, direct_lp(problem, b)[free:], atol=1e-4)


@pytest.mark.parametrize(("solver", "options"), [
    (BasisPursuitLp, {}), (BasisPursuit, {"norm": "largest", "solver": "SCIPY"})],
    ids=["linprog", "cvxpy"])
def test_a_tolerance_means_the_largest_row(
    solver: type[LinearRecovery], options: dict[str, Any]
) -> None:
    rng = np.random.default_rng(3)
    problem, b = all_penalised(rng), rng.standard_normal(60)
    x = recovered(solver(tolerance=0.1, **options), problem, b).x
    A = problem.A / np.linalg.norm(problem.A, axis=0)
    assert np.abs(A @ x - b).max() == pytest.approx(0.1 * np.abs(b).max(), rel=1e-6)
    np.testing.assert_allclose(x, direct_lp(problem, b, 0.1), atol=1e-5)


def test_a_tolerance_in_the_euclidean_norm_is_used_up() -> None:
    rng = np.random.default_rng(4)
    problem, b = all_penalised(rng), rng.standard_normal(60)
    x = recovered(BasisPursuit(tolerance=0.2), problem, b).x
    A = problem.A / np.linalg.norm(problem.A, axis=0)
    assert np.linalg.norm(A @ x - b) == pytest.approx(0.2 * np.linalg.norm(b), rel=1e-4)


def test_a_penalised_solution_satisfies_its_optimality_conditions() -> None:
    """|gradient_j| is the penalty on active columns, with the sign of x_j, and not above it
    elsewhere; by group in units of 1 / budget."""
    rng = np.random.default_rng(5)
    problem, b = all_penalised(rng), rng.standard_normal(60)
    x = recovered(LassoLars(penalty=0.3), problem, b).x
    A = problem.A / np.linalg.norm(problem.A, axis=0)
    budgets = np.repeat([3.0, 2.0], [40, 30])
    penalty = 0.3 * np.abs((b @ A) * budgets).max()
    slope = (b - A @ x) @ A * budgets
    active = x != 0.0
    assert 3 < active.sum() < 60
    np.testing.assert_allclose(slope[active], penalty * np.sign(x[active]), rtol=1e-9)
    assert np.abs(slope).max() <= penalty * (1.0 + 1e-9)
