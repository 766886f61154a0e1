"""Time step of the sparse method: select atoms, then solve on the support with its reduced
operators."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from sparsemor.core import BoolArray, SolveFailed, State, StepFormula, StepOutcome
from sparsemor.core.protocols import AroundSteps
from sparsemor.reducers.sparse.memory import SparseMemory
from sparsemor.reducers.sparse.supported_steps import SupportedSteps
from sparsemor.reducers.step.newton_loop import Kept
from sparsemor.reducers.step.predictor import Past, block_starts
from sparsemor.reducers.step.solver import Stepper


class SelectsInStep(Protocol):
    """Solution of a step with a selection of atoms."""

    def solve(self, step: StepFormula, memory: SparseMemory) -> StepOutcome: ...


@dataclass(frozen=True, slots=True, eq=False)
class SparseStepper(AroundSteps[Stepper]):
    """Step solver with atom selection. base: step solver with the blocks in which no atoms are
    selected; steps: step solvers on the supports of the others; every: number of steps between
    selections."""

    steps: SupportedSteps
    selection: SelectsInStep
    every: int

    def start(self, state: State) -> tuple[State, SparseMemory]:
        reduced = self.base.reduced(state)
        return reduced, SparseMemory(
            past=Past(self.base.points, reduced.x, block_starts(self.layout)),
            kept=Kept.of(len(list(self.layout))),
            factorizations=self.base.factorizations, supports=self.steps.empty)

    def solve(self, step: StepFormula, memory: SparseMemory) -> tuple[StepOutcome, SparseMemory]:
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

    def frozen(self, memory: SparseMemory) -> tuple[Stepper, SparseMemory]:
        """Step solver with the current supports fixed, and its memory, for a linearised time-step
        map. Raises SolveFailed where the sampled rows do not distinguish the active atoms."""
        return self.steps.on(memory, memory.supports), memory

    def counters(self, memory: SparseMemory) -> Mapping[str, int]:
        return self.base.counters(memory)
