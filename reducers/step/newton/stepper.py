"""Step solver that solves for all unknowns together by Newton's method."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sparsemor.core import (
    BoolArray,
    Dictionary,
    IntArray,
    Layout,
    Note,
    ResultantSource,
    State,
    Status,
    StepFormula,
    StepOutcome,
    resultant_sources,
)
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.newton.equations import Equations
from sparsemor.reducers.step.newton.iteration import solve
from sparsemor.reducers.step.newton.memory import NewtonMemory
from sparsemor.reducers.step.predictor import block_starts
from sparsemor.reducers.step.rejection import rejected_step
from sparsemor.reducers.step.solver import Facts


@dataclass(frozen=True, slots=True, eq=False)
class NewtonStepper:
    """Step solver for the equations of a whole step. limits: largest permitted |coefficient| of a
    block, beyond which a run counts as divergent."""

    equations: Equations
    elements_touched: Mapping[str, int]
    tolerances: Tolerances
    points: int
    dictionaries: Mapping[str, Dictionary] = field(default_factory=dict)
    rows: Mapping[str, IntArray] = field(default_factory=dict)
    limits: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    facts: Facts = field(default_factory=dict)

    @property
    def layout(self) -> Layout:
        return self.equations.layout

    def start(self, state: State) -> tuple[State, NewtonMemory]:
        return state, NewtonMemory.of(
            state.x, self.points, block_starts(self.layout), self.equations.buffers)

    def solve(self, step: StepFormula, memory: NewtonMemory) -> tuple[StepOutcome, NewtonMemory]:
        equations = self.equations.of_run(memory)
        outcome = solve(equations, step, memory, self.tolerances)
        outcome = rejected_step(outcome, equations.checks, step)
        return (self._sane(outcome) if outcome.status.ok else outcome), memory

    def _sane(self, outcome: StepOutcome) -> StepOutcome:
        for name, limit in self.limits.items():
            top = float(np.abs(outcome.x[self.layout[name]]).max(initial=0.0))
            if not top <= limit:
                return replace(
                    outcome, status=Status.DIVERGED, block=name,
                    detail=f"largest coefficient {top:.3g}, {limit:.3g} allowed")
        return outcome

    def resultant_sources(self, memory: NewtonMemory | None) -> tuple[ResultantSource, ...]:
        if memory is None:
            return resultant_sources(self.equations.terms)
        # what is reported must not change how the run goes on
        return resultant_sources(self.equations.of_run(memory.at_newest()).terms)

    def supports(self, memory: NewtonMemory) -> Mapping[str, BoolArray]:
        return memory.supports

    def counters(self, memory: NewtonMemory) -> Mapping[str, int]:
        return memory.counters()
