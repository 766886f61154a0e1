"""Step solvers on given supports, and a step whose supports are selected at its own solution."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, TypeAlias, TypeVar

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray, Status, StepFormula, StepOutcome
from sparsemor.reducers.sparse.memory import SparseMemory, Supports, kept_or_made
from sparsemor.reducers.sparse.sampled_block import SampledElastic, SampledHeat, numbers
from sparsemor.reducers.sparse.supported_equations import SupportedMechanics
from sparsemor.reducers.step.solver import Stepper

ROUNDS = 10
"""Largest number of exchanges in a step without previous supports: each is made at the solution on
the last, and lowers its residual."""
T = TypeVar("T")
SupportOf: TypeAlias = Mapping[str, BoolArray]
"""Block -> its support (k,)."""


@dataclass(frozen=True, slots=True, eq=False)
class SupportedSteps:
    """Step solvers on any support of the blocks `heat` and `elastic`. base: step solver with the
    other blocks; mechanics: equations of all bodies; row_set: number of the set of sampled rows in
    the run."""

    base: Stepper
    mechanics: SupportedMechanics
    heat: Mapping[str, SampledHeat]
    elastic: Mapping[str, SampledElastic]
    row_set: int

    @property
    def empty(self) -> dict[str, BoolArray]:
        """Supports without atoms: reference temperatures and rigid bodies."""
        blocks = [h.block for h in self.heat.values()] + [e.block for e in self.elastic.values()]
        return {b.name: np.zeros(b.atoms, dtype=np.bool_) for b in blocks}

    def current(self, memory: SparseMemory) -> Stepper:
        """Step solver on the supports in `memory`. Raises SolveFailed where the sampled rows do not
        distinguish the active atoms."""
        if memory.current is None:
            memory.current = self.on(memory, memory.supports)
        return memory.current

    def on(self, memory: SparseMemory, supports: SupportOf) -> Stepper:
        """Step solver on these supports, kept in `memory`. Raises SolveFailed."""
        key = self.row_set, "", b"".join(
            supports[n].tobytes() for n in (*self.heat, *self.elastic))
        return kept_or_made(memory.steppers, key, lambda: self._made(memory, supports))

    def _made(self, memory: SparseMemory, supports: SupportOf) -> Stepper:
        """Step solver on these supports, from the parts of each block that are kept in `memory`."""
        def part(kept: dict[Supports, T], name: str, make: Callable[[IntArray | None], T]) -> T:
            support = supports[name]
            key = self.row_set, name, support.tobytes()
            return memory.counted_part(kept, key, lambda: make(numbers(support)))

        heat = {n: part(memory.heat, n, h.on) for n, h in self.heat.items()}
        elastic = {n: part(memory.elastic, n, e.on) for n, e in self.elastic.items()}
        return replace(self.base, heat={**self.base.heat, **heat},
                       mechanics=self.mechanics.on(elastic))

    def rows(self, at: "SolvedStep", memory: SparseMemory) -> FloatArray:
        """Residual of all sampled rows at the solution of a step."""
        return self.mechanics.working(memory).all_rows.at_solution(at.step, at.outcome)

    def elastic_rows(self, at: "SolvedStep", memory: SparseMemory) -> Mapping[str, FloatArray]:
        """The same of each elastic block, by the equations with which the step was solved."""
        return self.mechanics.working(memory).at_solution(
            at.step, at.outcome, {n: e.columns.B for n, e in self.elastic.items()})

    def accepted(
        self, outcome: StepOutcome, step: StepFormula, memory: SparseMemory
    ) -> StepOutcome:
        """The outcome, stored as a past state of the run; or the failure of a block whose
        coefficients exceed their limits, temperatures before the displacements that they cause."""
        outcome = self.base.accepted(outcome, step, memory)
        if outcome.status.ok:
            return outcome
        found = (self.base.beyond_limits(outcome.x, n) for n in self.heat)
        return next((bad for bad in found if bad is not None), outcome)


def take(found: SupportOf, memory: SparseMemory) -> bool:
    """Replaces the supports in `memory`; True if one of them has changed."""
    changed = False
    for name, support in found.items():
        if not np.array_equal(support, memory.supports[name]):
            memory.supports[name] = support
            memory.support_changes += 1
            changed = True
    if changed:
        memory.current = None
    return changed


@dataclass(frozen=True, slots=True, eq=False)
class SelectionFailed:
    """Failure of a selection: its block, status and number of iterations."""

    block: str
    status: Status
    iterations: int = 1
    detail: str = "selection of atoms"


Found: TypeAlias = dict[str, BoolArray] | SelectionFailed
"""Supports that change, by block."""


@dataclass(frozen=True, slots=True, eq=False)
class SolvedStep:
    """Solution of a step on given supports: `now` is the step solver that computed it, `fresh` is
    True where these supports are not those of an earlier step."""

    step: StepFormula
    outcome: StepOutcome
    now: Stepper
    supports: SupportOf
    fresh: bool


class SelectsAtSolution(Protocol):
    """Selection of supports at the solution of a step."""

    def thermal(self, at: SolvedStep, memory: SparseMemory) -> Found: ...

    def elastic(self, at: SolvedStep, memory: SparseMemory) -> Found: ...


def reselected_step(
    steps: SupportedSteps, selects: SelectsAtSolution, step: StepFormula, memory: SparseMemory,
    start: SupportOf,
) -> StepOutcome | None:
    """Solution of a step whose supports are selected at its solution on the supports `start`:
    thermal ones first, because temperatures load the bodies, then elastic ones. None where there is
    no solution on `start`."""
    fresh = start is not memory.supports
    kept, linearised_on, supports = memory.kept, memory.linearised_on, start

    def solved(guess: FloatArray | None) -> SolvedStep:
        # as if the step had not been solved on other supports
        memory.kept, memory.linearised_on = kept.copy(), linearised_on
        now = steps.on(memory, supports) if fresh or guess is not None else steps.current(memory)
        return SolvedStep(step, now.tried(step, memory, guess), now, supports, fresh)

    at = solved(None)
    if not at.outcome.status.ok:
        memory.kept, memory.linearised_on = kept, linearised_on
        return None
    for select in (selects.thermal, selects.elastic):
        for repeated in range(ROUNDS if fresh else 1):
            found = select(replace(at, fresh=False) if repeated else at, memory)
            if isinstance(found, SelectionFailed):
                memory.kept, memory.linearised_on = kept, linearised_on
                return StepOutcome(
                    at.outcome.x, found.status, found.iterations, found.block, found.detail)
            if not found:
                break
            supports = {**supports, **found}
            at = solved(at.outcome.x)
            if not at.outcome.status.ok:
                return at.outcome
    if take(supports, memory):
        memory.current = at.now
        if fresh:
            memory.past.restart()  # coefficients may jump: the past is no guide
    return steps.accepted(at.outcome, step, memory)
