"""Law kit of a sparse solver."""

from dataclasses import replace

import numpy as np

from sparsemor.core.errors import InputError
from sparsemor.core.protocols import (
    LimitsProblems,
    SparseOutcome,
    SparseProblem,
    SparseSolver,
    SparseStart,
)
from sparsemor.core.protocols.sparse_solver import PROBLEM_FEATURES, missing, solver_refusal
from sparsemor.core.status import Status
from sparsemor.core.testing.problems import (
    Elsewhere,
    LeastSquares,
    all_penalised,
    empty_start,
    incoherent,
    tall,
)
from sparsemor.core.testing.random_inputs import copied, law, unchanged


def check_sparse_solver(solver: SparseSolver, seed: int = 0, trials: int = 20) -> None:
    """Laws of a sparse solver: budgets, statuses, and recovery of a known support.

    Recovery is tested on Gaussian columns (5 active of 32 or 70, with 4 or no unpenalised ones, 60
    rows, no noise): from an empty support for a linear problem, from the true support for a mildly
    nonlinear one. A problem that needs a capability which the solver does not declare must be
    refused, naming the capability, by the check and by the solver.
    """
    _declares(solver)
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
    has = solver.capabilities if isinstance(solver, LimitsProblems) else PROBLEM_FEATURES.keys()
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
