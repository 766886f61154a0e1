"""Time step of the sparse method: select atoms, then solve on the support with its reduced
operators."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from sparsemor.core import BoolArray, SolveFailed, State, StepFormula, StepOutcome, UpdateRules
from sparsemor.core.protocols import AroundSteps, ManySteps, StepBlock
from sparsemor.reducers.sparse.memory import SparseMemory
from sparsemor.reducers.sparse.supported_steps import SupportedSteps
from sparsemor.reducers.step.compiled.stepper import Compiled, CompiledSteps, compiled_steps, wanted
from sparsemor.reducers.step.predictor import Past, block_starts
from sparsemor.reducers.step.solver import Stepper


class SelectsInStep(Protocol):
    """Solution of a step with a selection of atoms."""

    def solve(self, step: StepFormula, memory: SparseMemory) -> StepOutcome: ...


@dataclass(frozen=True, slots=True, eq=False)
class SparseStepper(AroundSteps[Stepper]):
    """Step solver with atom selection. base: step solver with the blocks in which no atoms are
    selected; steps: step solvers on the supports of the others; every: number of steps between
    selections; option: of compiled steps."""

    steps: SupportedSteps
    selection: SelectsInStep
    every: int
    option: Compiled = "off"

    def start(self, state: State) -> tuple[State, SparseMemory]:
        reduced = self.base.reduced(state)
        return reduced, SparseMemory(
            past=Past(self.base.points, reduced.x, block_starts(self.layout)),
            work=self.base.workspace(),
            factorizations=self.base.factorizations, supports=self.steps.empty)

    def solve(self, step: StepFormula, memory: SparseMemory) -> tuple[StepOutcome, SparseMemory]:
        due = memory.step % self.every == 0
        memory.step += 1
        try:
            if due:
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

    def many(
        self, rules: UpdateRules, h: float, steps: int
    ) -> "ManySteps[SparseMemory] | None":
        """Compiled steps between selections."""
        if self.every == 1 or not wanted(self.option, steps):
            return None
        return StepsBetween(self, rules, h)


class StepsBetween:
    """Compiled steps of a run on the supports selected last; made again when these change."""

    def __init__(self, solver: SparseStepper, rules: UpdateRules, h: float) -> None:
        self.solver = solver
        self.made = partial(compiled_steps, rules=rules, h=h)
        self._kept: tuple[Stepper, CompiledSteps | None] | None = None

    def advance(self, state: State, memory: SparseMemory, count: int) -> StepBlock:
        """Solves up to `count` steps, but none that selects atoms."""
        since = memory.step % self.solver.every
        try:
            steps = self._steps(self.solver.steps.current(memory)) if since else None
        except SolveFailed:  # `solve` will report it
            steps = None
        if steps is None:
            return StepBlock()
        block = steps.advance(state, memory, min(count, self.solver.every - since))
        memory.step += len(block)
        return block

    def _steps(self, now: Stepper) -> CompiledSteps | None:
        if self._kept is None or self._kept[0] is not now:
            self._kept = now, self.made(now)
        return self._kept[1]
