"""Time step of the sparse method: atoms are selected at the solution of a step, which is then
solved again on their support with its reduced operators."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeVar

import numpy as np

from sparsemor.core import (
    BoolArray,
    FloatArray,
    IntArray,
    SolveFailed,
    State,
    Status,
    StepFormula,
    StepOutcome,
)
from sparsemor.core.protocols.step_solver import AroundSteps
from sparsemor.reducers.sparse.sampled_block import SampledElastic, SampledHeat, numbers
from sparsemor.reducers.sparse.sparse_memory import SparseMemory, Supports, get_or_create
from sparsemor.reducers.sparse.supported_equations import SupportedMechanics
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.newton_loop import KeptJacobian
from sparsemor.reducers.step.predictor import Predictor, block_starts

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

    base: BlockwiseSolver
    mechanics: SupportedMechanics
    heat: Mapping[str, SampledHeat]
    elastic: Mapping[str, SampledElastic]
    row_set: int

    @property
    def empty(self) -> dict[str, BoolArray]:
        """Supports without atoms: reference temperatures and rigid bodies."""
        blocks = [h.block for h in self.heat.values()] + [e.block for e in self.elastic.values()]
        return {b.name: np.zeros(b.atoms, dtype=np.bool_) for b in blocks}

    def current(self, memory: SparseMemory) -> BlockwiseSolver:
        """Step solver on the supports in `memory`. Raises SolveFailed where the sampled rows do not
        distinguish the active atoms."""
        if memory.current is None:
            memory.current = self.on(memory, memory.supports)
        return memory.current

    def on(self, memory: SparseMemory, supports: SupportOf) -> BlockwiseSolver:
        """Step solver on these supports, kept in `memory`. Raises SolveFailed."""
        key = self.row_set, "", b"".join(
            supports[n].tobytes() for n in (*self.heat, *self.elastic))
        return get_or_create(memory.steppers, key, lambda: self._made(memory, supports))

    def _made(self, memory: SparseMemory, supports: SupportOf) -> BlockwiseSolver:
        """Step solver on these supports, from the parts of each block that are kept in `memory`."""
        def part(kept: dict[Supports, T], name: str, make: Callable[[IntArray | None], T]) -> T:
            """The kept part of a block on its support, or one by `make` of its active atoms."""
            support = supports[name]
            key = self.row_set, name, support.tobytes()
            return memory.counted_part(kept, key, lambda: make(numbers(support)))

        heat = {n: part(memory.heat, n, h.on) for n, h in self.heat.items()}
        elastic = {n: part(memory.elastic, n, e.on) for n, e in self.elastic.items()}
        return replace(self.base, heat={**self.base.heat, **heat},
                       mechanics=self.mechanics.on(elastic))

    def rows(self, at: "SolvedStep", memory: SparseMemory) -> FloatArray:
        """Residual of the sampled rows of temperatures at the solution of a step."""
        return self.mechanics.working(memory).heat.at_solution(at.step, at.outcome)

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
        return self.base.beyond_limits(outcome.x, list(self.heat)) or outcome


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
class SolvedStep:
    """Solution of a step on given supports: `now` is the step solver that computed it, `fresh` is
    True where these supports are not those of an earlier step."""

    step: StepFormula
    outcome: StepOutcome
    now: BlockwiseSolver
    supports: SupportOf
    fresh: bool


@dataclass(frozen=True, slots=True, eq=False)
class AtomSelection(ABC):
    """Selection of atoms in a step. steps: step solvers on supports; hysteresis: fraction by which
    other supports must lower the residual norm to replace those of the previous step.

    A failure is raised as SolveFailed, with the block in which no atoms could be selected."""

    steps: SupportedSteps
    hysteresis: float

    @abstractmethod
    def solve(self, step: StepFormula, memory: SparseMemory) -> StepOutcome:
        """Solution of a step with a selection in all blocks."""

    @abstractmethod
    def thermal(self, at: SolvedStep, memory: SparseMemory) -> dict[str, BoolArray]:
        """Thermal blocks with other supports that replace those of a solution."""

    @abstractmethod
    def elastic(self, at: SolvedStep, memory: SparseMemory) -> dict[str, BoolArray]:
        """Elastic blocks with other supports that replace those of a solution."""

    def reselected(
        self, step: StepFormula, memory: SparseMemory, start: SupportOf
    ) -> StepOutcome | None:
        """Solution of a step whose supports are selected at its solution on the supports `start`:
        thermal ones first, because temperatures load the bodies, then elastic ones. Where `start`
        is not the supports of the step before (`fresh`), up to `ROUNDS` exchanges are made, else
        one. None where there is no solution on `start`."""
        steps, fresh, supports = self.steps, start is not memory.supports, start
        # the Jacobian kept from earlier steps, and the active unknowns for which it was computed
        kept, linearised_on = memory.kept, memory.linearised_on

        def solved(guess: FloatArray | None) -> SolvedStep:
            """The step on the present `supports`, from a guess (n,), None: extrapolated."""
            # as if the step had not been solved on other supports
            memory.kept, memory.linearised_on = kept.copy(), linearised_on
            now = steps.on(memory, supports) if fresh or guess is not None else (
                steps.current(memory))
            return SolvedStep(step, now.trial_solution(step, memory, guess), now, supports, fresh)

        at = solved(guess=None)
        if not at.outcome.status.ok:
            memory.kept, memory.linearised_on = kept, linearised_on
            return None
        for select in (self.thermal, self.elastic):
            for repeated in range(ROUNDS if fresh else 1):
                # the first exchange without earlier supports takes those of the solver as they are
                found = select(replace(at, fresh=False) if repeated else at, memory)
                if not found:
                    break
                supports = {**supports, **found}
                at = solved(at.outcome.x)
                if not at.outcome.status.ok:
                    return at.outcome
        if take(supports, memory):  # they differ from those of the last step
            memory.current = at.now
            if fresh:
                memory.past.restart()  # coefficients may jump: the past is no guide
        return steps.accepted(at.outcome, step, memory)


def no_selection(block: str, status: Status, detail: str = "") -> SolveFailed:
    """Failure of a selection in a block."""
    return SolveFailed(status, 0.0, block, f"selection of atoms{detail and ', '}{detail}")


@dataclass(frozen=True, slots=True, eq=False)
class SparseStepper(AroundSteps[BlockwiseSolver]):
    """Step solver with atom selection. base: step solver with the blocks in which no atoms are
    selected; steps: step solvers on the supports of the others; every: number of steps between
    selections."""

    steps: SupportedSteps
    selection: AtomSelection
    every: int

    def start(self, state: State) -> tuple[State, SparseMemory]:
        reduced = self.base.reduced(state)
        return reduced, SparseMemory(
            past=Predictor(self.base.points, reduced.x, block_starts(self.layout)),
            kept=KeptJacobian.empty(len(list(self.layout))),
            factorizations=self.base.factorizations, supports=self.steps.empty)

    def solve(self, step: StepFormula, memory: SparseMemory) -> tuple[StepOutcome, SparseMemory]:
        """A step with a selection, or on the supports of the step before; a failure, at the
        extrapolated state, where no atoms can be selected."""
        selects = memory.step % self.every == 0
        memory.step += 1
        try:
            if selects:
                return self.selection.solve(step, memory), memory
            return self.steps.current(memory).solve(step, memory)[0], memory
        except SolveFailed as error:
            x = step.free + memory.past.guess(step)
            return StepOutcome(x, error.status, 0, error.block, error.detail), memory

    def supports(self, memory: SparseMemory) -> Mapping[str, BoolArray]:
        return memory.supports

    def frozen(self, memory: SparseMemory) -> tuple[BlockwiseSolver, SparseMemory]:
        """Step solver with the current supports fixed, and its memory, for a linearised time-step
        map. Raises SolveFailed where the sampled rows do not distinguish the active atoms."""
        return self.steps.on(memory, memory.supports), memory

    def counters(self, memory: SparseMemory) -> Mapping[str, int]:
        return self.base.counters(memory)
