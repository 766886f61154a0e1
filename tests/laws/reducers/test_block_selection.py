"""Selection of atoms block by block: the first step, exchanges of supports, least squares on
subsets of columns."""

from threading import Thread
from typing import Any

import numpy as np
import pytest

from recovery import SOLVERS
from small_scenes import tiny
from sparsemor.core import ReducedProblem, Selection
from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.core.model.assembly import assemble
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.status import SolveFailed, Status
from sparsemor.core.testing.in_memory_run import march
from sparsemor.core.testing.sparse_problems import one_group
from sparsemor.reducers.sparse.block_selection import AtSolution, BlockSelection, exchanged
from sparsemor.reducers.sparse.block_selection import BlockwiseSelection as Blockwise
from sparsemor.reducers.sparse.sampled_block import RangeColumns
from sparsemor.reducers.sparse.supported_steps import SparseStepper
from tiers import quick

FEW: dict[str, Any] = {"use": "sparse", "basis": {"use": "pod", "count": 8}, "bases": {}}


# ------------------------------------------------------------------------ first step


@pytest.mark.full
@pytest.mark.parametrize("rows", [14, 3])
def test_the_first_selection_starts_from_all_atoms_that_the_rows_distinguish(rows: int) -> None:
    """From none where there are fewer rows than atoms."""
    scene = tiny().using({"reducer": FEW}).using({
        "reducer.budgets": {"*.elastic": {"rows": rows, "atoms": 4}, "*.thermal": {"rows": 10}},
        "reducer.sampler": {"use": "lhs", "required": False},
        "reducer.solver": {"use": "greedy_gauss_newton", "candidates": "correlated"}})
    model = assemble(scene)
    run = march(scene.using({"reducer": "full", "time.end": 20 * scene.time.step}), model=model)
    snapshots = {n: run.block(n).T for n in model.reducible()}
    if rows < 4:
        scene = scene.using({"reducer.budgets.*.elastic.atoms": 2})
    solver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, Offline.from_snapshots(model, snapshots),
        np.random.default_rng(1)))
    assert isinstance(solver, SparseStepper) and isinstance(solver.selection, Blockwise)
    assert solver.selection.distinguishable["bar.elastic"].all() == (rows == 14)
    assert solver.selection.distinguishable["bar.elastic"].any() == (rows == 14)
    got = march(scene.using({"time.end": 5 * scene.time.step}), model=model, snapshots=snapshots)
    assert 0 < np.count_nonzero(got.block("bar.elastic")[-1]) <= 4


# ------------------------------------------------------------------------ exchanges


class Rows:
    """Sampled rows of a block without physics."""

    def __init__(self, B: FloatArray, budget: int) -> None:
        self.columns, self.budget = RangeColumns.from_matrix("block", B), budget
        self.name, self.at = "block", slice(0, B.shape[1])

    def residual(self, step: Any, x: FloatArray, now: Any, work: Any) -> FloatArray:
        raise NotImplementedError


def made(B: FloatArray, budget: int, solver: Any) -> BlockSelection:
    return BlockSelection.from_rows(Rows(B, budget), solver)


def minimised(block: BlockSelection, b: FloatArray, support: BoolArray) -> AtSolution:
    """The block at its least-squares solution on a support, for right-hand sides b (l,) of all
    rows."""
    B = block.rows.columns.B
    c = np.zeros(B.shape[1])
    c[support] = np.linalg.lstsq(B[:, support], b[: len(B)])[0]
    r = -b.copy()
    r[: len(B)] += B @ c
    return block.at(r, c, support)


@pytest.mark.parametrize("name", quick(sorted(SOLVERS), "greedy_gauss_newton", "omp", "cosamp"))
def test_a_support_is_left_only_for_one_that_is_better_by_the_hysteresis(name: str) -> None:
    """Neighbouring columns are alike and the budget is too small, so that supports differ by
    degrees. Part of the residual is in rows that no column reaches."""
    left = kept = 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        A = rng.standard_normal((12, 12)) * 10.0 ** rng.uniform(-2.0, 2.0, 12)
        A += 1.5 * np.roll(A, 1, axis=1)
        block = made(A, 3, SOLVERS[name])
        c = rng.standard_normal(12) / block.rows.columns.lengths
        b = np.concatenate((A @ c, [0.1 * seed]))
        support = np.zeros(12, dtype=np.bool_)
        support[rng.choice(12, 3, replace=False)] = True
        at = minimised(block, b, support)
        assert at.current == pytest.approx(block.weight * (
            np.linalg.norm(at.range_residual) ** 2 + b[-1] ** 2))
        for hysteresis in (0.0, 0.1, 0.3, 0.9):
            found = exchanged([at], hysteresis)
            assert isinstance(found, dict)
            if not found:
                kept += 1
                continue
            left += 1
            after = minimised(block, b, found["block"]).current
            assert after < (1.0 - hysteresis) ** 2 * at.current
            assert found["block"].sum() <= 3
    assert left >= 8 and kept >= 4


def test_a_support_with_a_residual_below_the_tolerance_is_kept() -> None:
    rng = np.random.default_rng(5)
    A = rng.standard_normal((12, 12))
    support, c = np.arange(12) < 3, np.zeros(12)
    c[:3], c[8] = 1.0, 1e-4
    for tolerance, exchanges in ((1e-3, False), (1e-6, True)):
        block = BlockSelection.from_rows(Rows(A, 4), SOLVERS["greedy_gauss_newton"], tolerance)
        assert bool(exchanged([minimised(block, A @ c, support)], 0.3)) is exchanges


def test_blocks_decide_together_by_the_norm_of_all() -> None:
    """A block whose residual is small against another's keeps its support."""
    rng = np.random.default_rng(0)
    block = made(rng.standard_normal((12, 6)), 2, SOLVERS["greedy_gauss_newton"])
    b = block.rows.columns.B @ np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    wrong = minimised(block, b, np.arange(6) >= 4)
    right = minimised(block, b + 10.0 * rng.standard_normal(12), np.arange(6) < 2)
    assert exchanged([wrong], 0.3) and not exchanged([wrong, right], 0.3)


class Selects:
    """A solver that selects the first atoms of six, as many as it is told, with a status."""

    def __init__(self, count: int, status: Status = Status.DONE) -> None:
        self.selection = Selection(np.arange(6) < count, status)

    def prepare(self, columns: Any, budget: int) -> "Selects":
        return self

    def select(self, r: FloatArray, c: FloatArray, support: BoolArray) -> Selection:
        return self.selection


def test_no_solver_is_asked_where_all_atoms_together_do_not_help() -> None:
    rng = np.random.default_rng(0)
    block = made(rng.standard_normal((6, 6)), 2, Selects(6))
    at = minimised(block, np.concatenate((np.full(6, 1e-3), [1.0])), np.arange(6) < 2)
    assert exchanged([at], 0.3) == {}
    with pytest.raises(InputError, match="Selects selected 6 atoms in block, 2 allowed"):
        exchanged([minimised(block, np.concatenate((np.ones(6), [1e-3])), np.arange(6) < 2)], 0.3)


def test_a_support_that_the_rows_do_not_distinguish_is_not_taken() -> None:
    A = np.random.default_rng(0).standard_normal((8, 6))
    A[:, 1] = A[:, 0]
    block = made(A, 2, Selects(2))
    assert exchanged([minimised(block, A[:, 0], np.arange(6) >= 4)], 0.0) == {}


# ------------------------------------------------------------------------ recoveries


@pytest.mark.parametrize("name", quick(sorted(SOLVERS), "greedy_gauss_newton", "omp", "cosamp"))
def test_a_support_is_selected_again_from_noise(name: str) -> None:
    """Every solver here selects the support from J c - r alone (`greedy_gauss_newton` exchanges
    atoms until none pays), so that its own solution leads back to it."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        problem = one_group(rng)
        columns = ColumnSubsets(problem.A, 1e-12)
        recovery = SOLVERS[name].prepare(columns, 5)
        b = problem.A @ problem.answer + 0.05 * rng.standard_normal(60)
        support = np.arange(32) < 5
        for _ in range(2):
            c = columns.solution(support, b)
            assert c is not None
            before, support = support, recovery.select(problem.A @ c - b, c, support).support
        assert np.array_equal(support, before) and 0 < support.sum() <= 5


@pytest.mark.parametrize("name", quick(["greedy_gauss_newton", "cosamp"], "greedy_gauss_newton"))
def test_threads_share_a_recovery(name: str) -> None:
    """More supports than are kept, in other orders: each is what one thread finds."""
    rng = np.random.default_rng(0)
    problem = one_group(rng, m=40, k=30, active=4)
    sides = [problem.A @ rng.standard_normal(30) for _ in range(150)]

    def found(recovery: Any, order: range) -> dict[int, bytes]:
        none = np.zeros(30, dtype=np.bool_)
        return {i: recovery.select(-sides[i], np.zeros(30), none).support.tobytes() for i in order}

    alone = found(SOLVERS[name].prepare(ColumnSubsets(problem.A, 1e-12), 4), range(150))
    shared, several = SOLVERS[name].prepare(ColumnSubsets(problem.A, 1e-12), 4), []
    threads = [Thread(target=lambda o=o: several.append(found(shared, o)))
               for o in (range(150), range(149, -1, -1))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(alone.values())) > 64
    assert several == [alone, alone]


# ------------------------------------------------------------------------ subsets of columns


def test_least_squares_on_subsets_is_that_of_their_columns() -> None:
    rng = np.random.default_rng(0)
    A, b = rng.standard_normal((9, 6)), rng.standard_normal(9)
    columns = ColumnSubsets(A, 1e-12)
    for _ in range(3):
        for subset in (np.zeros(6, dtype=np.bool_), np.arange(6) > 2, np.ones(6, dtype=np.bool_)):
            x = columns.solution(subset, b)
            assert x is not None and columns.independent(subset)
            want = np.zeros(6)
            want[subset] = np.linalg.lstsq(A[:, subset], b)[0]
            np.testing.assert_allclose(x, want, atol=1e-13)
            square = columns.squared_residual(subset, b)
            assert square == pytest.approx(np.linalg.norm(A @ x - b) ** 2, rel=1e-12)


def test_dependent_columns_are_reported_and_their_least_norm_solution_is_found() -> None:
    rng = np.random.default_rng(0)
    A, b = rng.standard_normal((9, 6)), rng.standard_normal(9)
    A[:, 3] = A[:, 0] - A[:, 1]
    columns, subset = ColumnSubsets(A, 1e-12), np.arange(6) < 4
    assert not columns.independent(subset)
    assert columns.solution(subset, b) is None and columns.squared_residual(subset, b) is None
    want = np.linalg.lstsq(A[:, :4], b, rcond=1e-12)[0]
    np.testing.assert_allclose(columns.least_norm_solution(subset, b)[:4], want, atol=1e-13)
    wide = ColumnSubsets(rng.standard_normal((3, 5)), 1e-12)
    assert not wide.independent(np.ones(5, dtype=np.bool_)), "more columns than rows"


def test_a_status_that_is_no_success_stops_the_exchange() -> None:
    block = made(np.eye(6), 2, Selects(2, Status.INFEASIBLE))
    with pytest.raises(SolveFailed) as failed:
        exchanged([minimised(block, np.ones(6), np.arange(6) < 2)], 0.3)
    assert (failed.value.block, failed.value.status) == ("block", Status.INFEASIBLE)
