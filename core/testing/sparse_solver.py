"""Law kit of a sparse solver."""

from dataclasses import replace
from functools import partial

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.core.protocols.sparse_solver import (
    PROBLEM_FEATURES,
    Recovery,
    SparseOutcome,
    SparseProblem,
    SparseSolver,
    SparseStart,
    missing,
    solver_refusal,
)
from sparsemor.core.status import Status
from sparsemor.core.testing.random_inputs import (
    copied,
    keeps_contract,
    law,
    refused,
    unchanged,
)
from sparsemor.core.testing.sparse_problems import (
    Elsewhere,
    LeastSquares,
    all_penalised,
    empty_start,
    incoherent,
    one_group,
    tall,
)

RANK = 1e-12
"""Reciprocal condition number below which columns of the tests count as linearly dependent."""


def check_sparse_solver(solver: SparseSolver, seed: int = 0, trials: int = 20) -> None:
    """Laws of a sparse solver: budgets, statuses, and recovery of a known support.

    Recovery is tested on Gaussian columns (5 active of 32 or 70, with 4 or no unpenalised ones, 60
    rows, no noise): from an empty support for a linear problem, from the true support for a mildly
    nonlinear one. A problem that needs a capability which the solver does not declare must be
    refused, naming the capability, by the check and by the solver. What `prepare` returns obeys the
    same laws for linear problems with one group (`check_recovery`).
    """
    keeps_contract("sparse_solver", solver)
    _declares(solver)
    check_recovery(solver, seed, trials)
    for trial in range(trials):
        for make in (incoherent, tall, all_penalised):
            rng = np.random.default_rng([seed, trial])
            where = f"({make.__name__}, seed {seed}, trial {trial})"
            _solves(solver, make(rng), rng, where)
    _owns_up(solver, incoherent(np.random.default_rng(seed)))


def _solves(
    solver: SparseSolver, linear: LeastSquares, rng: np.random.Generator, where: str
) -> None:
    """Checks one problem: linear, nonlinear, from a support beyond the budget, and with noise."""
    bent = replace(linear, bend=0.02)
    near = linear.answer * (1.0 + 0.01 * rng.standard_normal(linear.answer.size))
    full = SparseStart(rng.standard_normal(near.size), np.ones(near.size, dtype=np.bool_))
    empty = empty_start(near.size)
    if solver_refusal("it", solver, linear.needs):
        _refused(solver, linear, empty, where)
        return
    _finds(solver, linear, empty, f"linear, empty start {where}")
    _well_formed(linear, solver.solve(linear, full), f"start beyond the budget {where}")
    noisy = _with_noise(linear, rng)
    _well_formed(noisy, solver.solve(noisy, empty), f"noisy {where}")
    if solver_refusal("it", solver, bent.needs):
        _refused(solver, bent, empty, where)
    else:
        _finds(solver, bent, SparseStart(near, bent.support), f"nonlinear, near start {where}")


def _declares(solver: SparseSolver) -> None:
    """Checks that the solver declares known capabilities only, and that a problem that needs
    another one is refused in words."""
    has = solver.capabilities
    unknown = sorted(set(has) - set(PROBLEM_FEATURES))
    law(not unknown, f"unknown capabilities {unknown}; there are {sorted(PROBLEM_FEATURES)}")
    for name in PROBLEM_FEATURES:
        words = solver_refusal("the problem", solver, frozenset({name}))
        law((name in words) != (name in has), f"capability {name}: refusal says {words!r}")


def _refused(
    solver: SparseSolver, problem: LeastSquares, start: SparseStart, where: str
) -> None:
    """Checks that `solve` raises InputError, which names the missing capabilities, for a refused
    problem."""
    lacking = missing(solver, problem.needs)
    try:
        status = solver.solve(problem, start).status
    except InputError as error:
        unnamed = [name for name in lacking if name not in str(error)]
        law(not unnamed, f"the refusal does not name {unnamed}: {error} {where}")
        return
    law(False, f"lacks {', '.join(lacking)}, yet took the problem: {status.value} {where}")


def _finds(solver: SparseSolver, problem: LeastSquares, start: SparseStart, where: str) -> None:
    """Checks that a solver finds the known answer, again from the same start, and leaves the start
    as it is."""
    before = copied(start)
    outcome, again = solver.solve(problem, start), solver.solve(problem, start)
    law(unchanged(start, before), f"the solver wrote to its start: {where}")
    law(np.array_equal(outcome.c, again.c) and np.array_equal(outcome.support, again.support),
        f"two solves from the same start differ: {where}")
    _well_formed(problem, outcome, where)
    law(outcome.status is Status.DONE, f"ended with {outcome.status.value}: {where}")
    error = np.linalg.norm(outcome.c - problem.answer) / np.linalg.norm(problem.answer)
    law(error < 1e-5, f"c has a relative error of {error:.1e}: {where}")
    missed = np.flatnonzero(problem.support & ~outcome.support)
    law(missed.size == 0, f"atoms {missed} of the answer are not in the support: {where}")


def _well_formed(problem: SparseProblem, outcome: SparseOutcome, where: str) -> None:
    """Checks an outcome: shapes, budgets, zeros outside the support, the residual norm that it
    reports."""
    k = max(g.stop for g in problem.groups)
    law(outcome.c.shape == (k,), f"c has shape {outcome.c.shape}, not ({k},): {where}")
    law(outcome.support.shape == (k,) and outcome.support.dtype == np.bool_,
        f"support must be bool of shape ({k},): {where}")
    law(np.isfinite(outcome.c).all(), f"c holds values that are not finite: {where}")
    for g in problem.groups:
        part = slice(g.start, g.stop)
        if g.budget is None:
            continue
        used = int(outcome.support[part].sum())
        law(used <= g.budget, f"{used} active atoms in {g.name}, budget {g.budget}: {where}")
        law(not outcome.c[part][~outcome.support[part]].any(),
            f"c is not zero outside the support in {g.name}: {where}")
    if outcome.status is Status.DONE:
        norm = float(np.linalg.norm(problem.residual(outcome.c)))
        scale = float(np.linalg.norm(problem.residual(np.zeros(k))))
        law(abs(norm - outcome.residual_norm) <= 1e-9 * max(norm, scale),
            f"residual_norm is {outcome.residual_norm:.3e}, that of c is {norm:.3e}: {where}")


def _with_noise(problem: LeastSquares, rng: np.random.Generator) -> Elsewhere:
    noise = 0.05 * rng.standard_normal(problem.A.shape[0])
    return Elsewhere(problem, lambda r: r + noise)


def _owns_up(solver: SparseSolver, problem: LeastSquares) -> None:
    """Checks that failures are reported by the status."""
    if solver_refusal("it", solver, problem.needs):
        return
    start = empty_start(problem.answer.size)
    nan = Elsewhere(problem, lambda r: np.full_like(r, np.nan))
    status = solver.solve(nan, start).status
    law(status is Status.NOT_FINITE, f"a residual of nan ended with {status.value}")
    A = problem.A.copy()
    A[:, 1] = A[:, 0]  # two free columns that no row can tell apart
    twins = replace(problem, A=A)
    status = solver.solve(twins, start).status
    law(not status.ok, "two equal unpenalised columns were reported as solved")


# ---------------------------------------------------------------- linear problems, constant matrix


def check_recovery(solver: SparseSolver, seed: int = 0, trials: int = 20) -> None:
    """Laws of the supports that a sparse solver selects for a constant matrix.

    The 5 active of 32 or 70 Gaussian unit columns are found from 60 rows: from no column, from
    wrong ones, and from all columns, which exceed the budget. A support that was found is found
    again from its own least-squares solution. Linearly dependent columns are never selected
    together without a status, and a residual that is not finite has one.
    """
    for trial in range(trials):
        for k in (32, 70):
            rng = np.random.default_rng([seed, trial, k])
            problem = one_group(rng, k=k)
            where = f"(60 rows, {k} columns, seed {seed}, trial {trial})"
            if solver_refusal("it", solver, problem.needs):
                refused(f"prepare, without {', '.join(missing(solver, problem.needs))} {where}",
                        partial(solver.prepare, ColumnSubsets(problem.A, RANK),
                                problem.groups[0].budget or 0))
            else:
                _selects(solver, problem, rng, where)


def _selects(
    solver: SparseSolver, problem: LeastSquares, rng: np.random.Generator, where: str
) -> None:
    """Checks a solver prepared for constant columns: it finds the support of the answer from
    several starts, and stays there."""
    columns, budget = ColumnSubsets(problem.A, RANK), problem.groups[0].budget or 0
    recovery = solver.prepare(columns, budget)
    m, k = problem.A.shape
    none, wrong = np.zeros(k, dtype=np.bool_), np.zeros(k, dtype=np.bool_)
    wrong[rng.choice(k, budget, replace=False)] = True
    starts = {"no column": none, "wrong columns": wrong}
    if k <= m:
        starts["all columns"] = np.ones(k, dtype=np.bool_)
    b = problem.A @ problem.answer
    for name, start in starts.items():
        found = _selected(recovery, columns, budget, start, b, f"from {name} {where}")
        lost = np.flatnonzero(problem.support & ~found)
        law(lost.size == 0, f"atoms {lost} of the answer are not selected from {name}: {where}")
        again = _selected(recovery, columns, budget, found, b, f"from its own solution {where}")
        law(np.array_equal(again, found), f"a support is left at its own solution: {where}")
    noisy = b + 0.05 * rng.standard_normal(m)
    _selected(recovery, columns, budget, wrong, noisy, f"noisy {where}")
    status = recovery.select(np.full(m, np.nan), np.zeros(k), wrong).status
    law(status is Status.NOT_FINITE, f"a residual of nan ended with {status.value}: {where}")
    _distinguishes_columns(solver, problem, where)


def _selected(
    recovery: Recovery, columns: ColumnSubsets, budget: int, support: BoolArray, b: FloatArray,
    where: str,
) -> BoolArray:
    """Support selected at the least-squares solution on `support` of columns.A x = b."""
    c = columns.solution(support, b)
    law(c is not None, f"the start has linearly dependent columns: {where}")
    assert c is not None
    r = columns.A @ c - b
    before = r.copy(), c.copy(), support.copy()
    found, again = (recovery.select(r, c, support) for _ in range(2))
    kept = all(np.array_equal(a, b) for a, b in zip((r, c, support), before, strict=True))
    law(kept, f"select wrote to its arguments: {where}")
    law(np.array_equal(found.support, again.support), f"two selections differ: {where}")
    law(found.status is Status.DONE, f"ended with {found.status.value}: {where}")
    law(found.support.shape == c.shape and found.support.dtype == np.bool_,
        f"support must be bool of shape {c.shape}: {where}")
    used = int(found.support.sum())
    law(used <= budget, f"{used} active atoms, budget {budget}: {where}")
    return found.support


def _distinguishes_columns(solver: SparseSolver, problem: LeastSquares, where: str) -> None:
    """Checks that two equal columns are not both selected, unless the status reports it."""
    A, active = problem.A.copy(), np.flatnonzero(problem.support)
    A[:, active[0]] = A[:, active[1]]
    columns, none = ColumnSubsets(A, RANK), np.zeros(A.shape[1], dtype=np.bool_)
    recovery = solver.prepare(columns, len(active))
    found = recovery.select(-A @ problem.answer, np.zeros(A.shape[1]), none)
    law(not found.status.ok or columns.independent(found.support),
        f"linearly dependent columns are selected with status {found.status.value}: {where}")
