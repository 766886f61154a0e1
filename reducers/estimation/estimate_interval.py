"""Number of steps from one estimate of errors to the next whose cost is a small share of the run's.

Work is counted, not timed, in steps of a reduced model without local terms in NumPy: an estimate of
blocks alone takes 0.45 of them and one of the whole model 2, in which terms that are evaluated on
the whole mesh visit each of its rows once or twice. tests/benchmarks/errors/random_estimates.py
measures the share.
"""

import math

from sparsemor.core import ReducedProblem, SolveFailed, StepSolver
from sparsemor.reducers.estimation.coupled_errors import CoupledErrors
from sparsemor.reducers.estimation.error_model_assembly import Active, error_model, is_whole
from sparsemor.reducers.estimation.estimator import ErrorModel

SHARE = 0.05
"""Largest share of the work of a run's steps."""
BLOCKS, WHOLE = 0.45, 2.0
"""Work of an estimate of blocks alone, and of the whole model."""
ROWS, ELEMENTS = 110.0, 200.0
"""Rows of local terms that an estimate visits, and elements that a step does, for a unit of
work."""
COMPILED = 16.0
"""Steps as machine code in the time of one in NumPy."""


def steps_between(problem: ReducedProblem, solver: StepSolver, compiled: bool) -> int:
    """Number of steps of runs of `solver` from one estimate to the next; compiled: True if the
    steps are machine code."""
    s = problem.model.separated
    rows = sum(len(t.rows) for t in (*(t for b in s.heat for t in b.local), *s.elastic_local))
    passes = 2 if s.elastic_local else 1
    work = WHOLE * (1.0 + passes * rows / ROWS) if is_whole(problem.model) else BLOCKS
    step = 1.0 + sum(solver.elements_touched.values()) / ELEMENTS
    every = math.ceil(work / (SHARE * step) * (COMPILED if compiled else 1.0))
    return min(every, problem.steps) if problem.steps else every


def affordable_model(
    problem: ReducedProblem, solver: StepSolver, active: Active, compiled: bool
) -> ErrorModel | CoupledErrors | None:
    """Error model of the runs of `solver` at a cost of at most `SHARE` of their steps; None where
    nothing is reduced, a step has several solves, or an operator cannot be factorized."""
    if not (solver.dictionaries and problem.integrator.one_solve):
        return None
    # problem.every: of a run that is resumed, 0 for a new one
    every = problem.every or steps_between(problem, solver, compiled)
    try:
        return error_model(problem, solver, every, active, at_few_steps=True)
    except SolveFailed:
        return None
