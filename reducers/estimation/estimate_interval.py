"""Number of steps from one estimate of errors to the next whose cost is a small share of the run's.

Work is counted, not timed, in steps of a reduced model without local terms in NumPy: an estimate of
blocks alone takes 0.6 of them and one of the whole model 2, in which terms that are evaluated on
the whole mesh visit each of its rows once or twice. tests/benchmarks/errors/random_estimates.py
measures the share.
"""

import math

from sparsemor.core import ReducedProblem, SolveFailed, StepSolver
from sparsemor.reducers.estimation.coupled_errors import CoupledErrors
from sparsemor.reducers.estimation.error_model_assembly import (
    Active,
    error_model,
    is_whole,
    iterations,
)
from sparsemor.reducers.estimation.estimator import ErrorModel
from sparsemor.reducers.estimation.modal_steps import FIRST

SHARE = 0.05
"""Largest share of the work of a run's steps."""
BLOCKS, WHOLE = 0.6, 2.0
"""Work of an estimate of blocks alone, and of the whole model."""
ROWS, ELEMENTS = 110.0, 200.0
"""Rows of local terms that an estimate visits, and elements that a step does, for a unit of
work."""
COMPILED = 16.0
"""Steps as machine code in the time of one in NumPy."""


def steps_between(
    problem: ReducedProblem, solver: StepSolver, compiled: bool
) -> tuple[int, int]:
    """Number of steps of runs of `solver` from one estimate to the next, and of first steps with
    one each (`begins`), of models that can vibrate. compiled: True if the steps are machine
    code. work of an estimate and step are in units of one step without local terms in NumPy; the
    interval is so long that estimates take the share `SHARE` of the run's work."""
    s, layout = problem.model.separated, problem.model.layout
    rows = sum(len(t.rows) for t in (*(t for b in s.heat for t in b.local), *s.elastic_local))
    visits = iterations(problem.model) * rows  # of rows in one estimate
    work = WHOLE * (1.0 + visits / ROWS) if is_whole(problem.model) else BLOCKS
    step = 1.0 + sum(solver.elements_touched.values()) / ELEMENTS
    every = math.ceil(work / (SHARE * step) * (COMPILED if compiled else 1.0))
    if problem.steps:
        every = min(every, problem.steps)
    dear = 0 < problem.steps < FIRST * every  # more than all others together
    vibrates = layout.second.stop > layout.second.start
    return every, 0 if not vibrates else 2 if dear else FIRST


def affordable_model(
    problem: ReducedProblem, solver: StepSolver, active: Active, compiled: bool
) -> ErrorModel | CoupledErrors | None:
    """Error model of the runs of `solver` at a cost of at most `SHARE` of their steps; None where
    nothing is reduced, a step has several solves, or an operator cannot be factorized. active:
    largest number of active atoms of a block with so many atoms; compiled: True if the steps are
    machine code."""
    if not (solver.dictionaries and problem.integrator.one_solve):
        return None
    every, first = steps_between(problem, solver, compiled)
    # problem.every: of a run that is resumed, 0 for a new one
    try:
        return error_model(problem, solver, problem.every or every, active, at_few_steps=True,
                           first=first)
    except SolveFailed:
        return None
