"""The time loop: formula, solve and advance, written once for runs, training and linearization."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import repeat
from typing import Any, NamedTuple

from sparsemor.core.protocols import Integrator, State, StepOutcome, StepSolver
from sparsemor.core.status import SolveFailed


class TimeStep(NamedTuple):
    """Outcome of one time step. state and memory are those after it; where it failed, the state is
    the one that it started from. seconds: wall-clock time of the step."""

    outcome: StepOutcome
    state: State
    memory: Any
    seconds: float


Step = Callable[[State, Any], tuple[StepOutcome, State, Any]]
"""State and memory -> outcome, and both after one time step, as in `TimeStep`."""


@dataclass(frozen=True, slots=True, eq=False)
class FixedStep:
    """Time step of h (s): the integrator's substitution for the rates, then the solver."""

    integrator: Integrator
    solver: StepSolver
    h: float

    def __call__(self, state: State, memory: Any) -> tuple[StepOutcome, State, Any]:
        layout, integrator = self.solver.layout, self.integrator
        formula = integrator.formula(layout, state, self.h)
        outcome, memory = self.solver.solve(formula, memory)
        if outcome.status.ok:
            state = integrator.advance(layout, state, formula, outcome.x, self.h)
        return outcome, state, memory


def started(solver: StepSolver, integrator: Integrator, full: State) -> tuple[State, Any]:
    """Full-order state in the solver's unknowns with the integrator's history, and a new memory."""
    state, memory = solver.start(full)
    return integrator.start(solver.layout, state), memory


def iterate(
    step: Step, state: State, memory: Any, count: int,
    interrupted: Callable[[], bool] = lambda: False,
) -> Iterator[TimeStep]:
    """Up to `count` successive time steps. Ends after the first one that fails, which is the last
    one given, and before a step where `interrupted` is true."""
    for _ in repeat(None, count):
        if interrupted():
            return
        begun = time.perf_counter()
        outcome, state, memory = step(state, memory)
        yield TimeStep(outcome, state, memory, time.perf_counter() - begun)
        if not outcome.status.ok:
            return


def accepted_steps(
    step: Step, state: State, memory: Any, count: int, h: float
) -> Iterator[TimeStep]:
    """As `iterate`, with SolveFailed where a step of h (s) fails."""
    for taken in iterate(step, state, memory, count):
        outcome = taken.outcome
        if not outcome.status.ok:
            raise SolveFailed(outcome.status, taken.state.t + h, outcome.block, outcome.detail)
        yield taken
