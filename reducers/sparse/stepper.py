"""Time step of the sparse method: select atoms, then solve on the support with its reduced
operators."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from sparsemor.core import (
    AroundSteps,
    BoolArray,
    FloatArray,
    IntArray,
    SolveFailed,
    SparseOutcome,
    SparseSolver,
    SparseStart,
    State,
    Status,
    StepFormula,
    StepOutcome,
    checked_return,
)
from sparsemor.reducers.sparse.elastic_screen import Screens
from sparsemor.reducers.sparse.joint_problem import HeatProblem, MechanicsProblem
from sparsemor.reducers.sparse.memory import SparseMemory, Supports, kept_or_made
from sparsemor.reducers.sparse.sampled_block import (
    SampledElastic,
    SampledHeat,
    numbers,
)
from sparsemor.reducers.step.predictor import Past, block_starts
from sparsemor.reducers.step.solver import Stepper
from sparsemor.reducers.step.step_unknowns import StepUnknowns

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class SparseStepper(AroundSteps[Stepper]):
    """Step solver with atom selection. base: step solver with the blocks in which no atoms are
    selected; heat, elastic: the blocks whose budget is smaller than the dictionary.

    every: number of steps between selections; carried: start a selection from the previous support;
    polish: re-solve the step on the selected support, with exact equations of rigid coordinates and
    multipliers; screen: check first if an exchange of atoms can reduce the residual; row_set:
    number of its set of sampled rows in the run.
    """

    heat: Mapping[str, SampledHeat]
    elastic: Mapping[str, SampledElastic]
    solver: SparseSolver
    every: int
    carried: bool
    polish: bool
    screen: bool = False
    row_set: int = 0

    def start(self, state: State) -> tuple[State, SparseMemory]:
        reduced = self.base.reduced(state)
        blocks = [h.block for h in self.heat.values()] + [e.block for e in self.elastic.values()]
        return reduced, SparseMemory(
            past=Past(self.base.points, reduced.x, block_starts(self.layout)),
            work=self.base.workspace(),
            factorizations=self.base.factorizations,
            supports={b.name: np.zeros(b.atoms, dtype=np.bool_) for b in blocks})

    def solve(self, step: StepFormula, memory: SparseMemory) -> tuple[StepOutcome, SparseMemory]:
        due = memory.step % self.every == 0
        memory.step += 1
        try:
            if due:
                carried = self._carried(step, memory)
                if carried is not None:
                    return carried, memory
                found = self._select(step, memory)
                if not found.status.ok:
                    return found, memory
                if not self.polish and self.elastic:  # else the mechanics are not solved yet
                    return self.base.accepted(found, step, memory), memory
            if memory.current is None:
                memory.current = self._prepared(memory, memory.supports)
        except SolveFailed as error:
            x = step.free + memory.past.guess(step)
            return StepOutcome(x, error.status, 0, error.block, error.detail), memory
        outcome, _ = memory.current.solve(step, memory)
        return outcome, memory

    def _carried(self, step: StepFormula, memory: SparseMemory) -> StepOutcome | None:
        """Step with a selection that starts from the step's solution on the previous support; None
        where there is no such solution."""
        if not (self.polish and self.carried):
            return None
        if memory.current is None:
            if not all(s.any() for s in memory.supports.values()):
                return None
            memory.current = self._prepared(memory, memory.supports)
        scales, now = memory.scales.copy(), memory.current
        tried = now.tried(step, memory)
        found = self._heat_supports(step, tried, memory)
        if found:  # other temperatures load the bodies differently
            now = self._prepared(memory, {**memory.supports, **found})
            tried = now.tried(step, memory, tried.x)
        if found is not None:
            bent = self._elastic_supports(step, tried, now, memory)
            found = None if bent is None else {**found, **bent}
        if found is not None and not found:
            return self._named(self.base.accepted(tried, step, memory))
        memory.scales = scales  # as if the carried support had not been tried
        if found is None:
            return None
        self._take(found, memory)  # changes at the threshold: the past remains a guide
        memory.current = self._prepared(memory, memory.supports)
        outcome = memory.current.tried(step, memory, tried.x)
        if not outcome.status.ok:
            return outcome
        return self._named(self.base.accepted(outcome, step, memory))

    def _heat_supports(
        self, step: StepFormula, tried: StepOutcome, memory: SparseMemory
    ) -> dict[str, BoolArray] | None:
        """Changed supports of thermal blocks; None when the step or its selection failed."""
        if not tried.status.ok:
            return None
        screens = self.screens_of(memory)
        screen = None if screens is None else screens.heat
        if screen is not None and screen.stay(step, tried.x, memory.supports):
            return {}
        changed = {}
        for name in self.heat:
            before = memory.supports[name]
            found = None if screen is None else screen.supports(name, step, tried.x, before)
            if found is None:
                out = self._heat_solved(name, step, tried.x, before)
                if not out.status.ok:
                    return None
                found = out.support
            if not np.array_equal(found, before):
                changed[name] = found
        return changed

    def _elastic_supports(
        self, step: StepFormula, tried: StepOutcome, now: Stepper, memory: SparseMemory
    ) -> dict[str, BoolArray] | None:
        """Changed supports of elastic blocks, None when the step or its selection failed; now: the
        step solver that computed `tried`."""
        if not tried.status.ok:
            return None
        if not self.elastic:
            return {}
        screens, found = self.screens_of(memory), None
        if screens is not None and screens.elastic is not None and now.mechanics is not None:
            found = screens.elastic.supports(
                step, tried.x, now.mechanics, memory.work, memory.supports)
        if found is None:
            found = {}
            out = self._select_elastic(step, tried.x.copy(), memory, found)
            if not out.status.ok:
                return None
        return {n: s for n, s in found.items() if not np.array_equal(s, memory.supports[n])}

    def _heat_solved(
        self, name: str, step: StepFormula, x: FloatArray, first: BoolArray
    ) -> SparseOutcome:
        """Result of the sparse solver for one thermal block, started from the support `first`."""
        at = self.layout[name]
        problem = HeatProblem.at(self.heat[name], step.r1[at], step.t)
        start = SparseStart(np.where(first, x[at], 0.0), first)
        return checked_return(self.solver.solve(problem, start), SparseOutcome, self.solver,
                              "solve", "reducer.solver")

    def _named(self, outcome: StepOutcome) -> StepOutcome:
        """The outcome, or the failure of a thermal block whose coefficients exceed their limits:
        reported before the displacements that its temperatures cause."""
        if outcome.status.ok:
            return outcome
        found = (self.base.insane(outcome.x, n) for n in self.heat)
        return next((bad for bad in found if bad is not None), outcome)

    def screens_of(self, memory: SparseMemory) -> Screens | None:
        """Screening for the set of rows in use; None where the sparse solver is run in every
        step."""
        if not self.screen:
            return None
        if self.row_set not in memory.screens:
            memory.screens[self.row_set] = Screens.of(
                self.base, self.heat, self.elastic, self.solver)
        return memory.screens[self.row_set]

    def _select(self, step: StepFormula, memory: SparseMemory) -> StepOutcome:
        """New supports for this step with the solution of the sparse solver; heat first, because
        its temperatures load the bodies."""
        now, iterations = StepUnknowns(step, memory.past.guess(step)), 0
        x = now.x
        found: dict[str, BoolArray] = {}
        for name, at in self.base.hot:
            if name not in self.heat:
                now.heat(at, None, self.base.heat[name].solve(x[at], now.v[at], step.t).d)
                continue
            out = self._heat_solved(name, step, x, self._first(memory.supports[name]))
            if not out.status.ok:
                return StepOutcome(x, out.status, out.iterations, name, "selection of atoms")
            found[name], x[at] = out.support, out.c
            iterations = max(iterations, out.iterations)
            # temperatures out of bounds would only show in the bodies that they load
            insane = self.base.insane(x, name)
            if insane is not None:
                return insane
        if self.elastic:
            mechanics = self._select_elastic(step, x, memory, found)
            if not mechanics.status.ok:
                return mechanics
            iterations = mechanics.iterations
        if self._take(found, memory):
            memory.past.restart()  # coefficients may have jumped: the past is no guide
        return StepOutcome(x, Status.DONE, iterations, rates=step.at(x - step.free)[1:])

    def _take(self, found: Mapping[str, BoolArray], memory: SparseMemory) -> bool:
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

    def _select_elastic(
        self, step: StepFormula, x: FloatArray, memory: SparseMemory, found: dict[str, BoolArray]
    ) -> StepOutcome:
        """Selection of atoms in all elastic blocks by one least-squares problem; its solution is
        written to x."""
        mechanics = self.base.mechanics
        assert mechanics is not None
        sampled = [self.elastic.get(b.elastic_name) for b in mechanics.bodies]
        problem = MechanicsProblem(mechanics, sampled, step, x)
        c = problem.start()
        support = np.ones(len(c), dtype=bool)
        for g in problem.groups[:-1]:
            support[g.start : g.stop] = self._first(memory.supports[g.name])
        out = checked_return(self.solver.solve(problem, SparseStart(c, support)), SparseOutcome,
                       self.solver, "solve", "reducer.solver")
        if not out.status.ok:
            detail = f"selection of atoms, residual {out.residual_norm:.1e}"
            return StepOutcome(x, out.status, out.iterations, problem.groups[0].name, detail)
        for g in problem.groups[:-1]:
            found[g.name] = out.support[g.start : g.stop]
            x[self.layout[g.name]] = out.c[g.start : g.stop]
        y, nr = out.c[problem.k :], mechanics.n_rigid
        x[:nr], x[mechanics.algebraic] = y[:nr], y[nr:]
        return StepOutcome(x, Status.DONE, out.iterations)

    def _first(self, support: BoolArray) -> BoolArray:
        """Initial support of a selection."""
        return support if self.carried else np.zeros_like(support)

    def _prepared(self, memory: SparseMemory, supports: Mapping[str, BoolArray]) -> Stepper:
        names = (*self.heat, *self.elastic)
        key = self.row_set, "", b"".join(supports[n].tobytes() for n in names)
        return kept_or_made(memory.steppers, key, lambda: self._made(memory, supports))

    def _made(self, memory: SparseMemory, supports: Mapping[str, BoolArray]) -> Stepper:
        def part(kept: dict[Supports, T], name: str, make: Callable[[IntArray | None], T]) -> T:
            support = supports[name]
            key = self.row_set, name, support.tobytes()
            return memory.counted_part(kept, key, lambda: make(numbers(support)))

        return self.base.with_blocks(
            {n: part(memory.heat, n, h.prepared) for n, h in self.heat.items()},
            {n: part(memory.elastic, n, e.prepared) for n, e in self.elastic.items()})

    def supports(self, memory: SparseMemory) -> Mapping[str, BoolArray]:
        return memory.supports

    def frozen(self, memory: SparseMemory) -> tuple[Stepper, SparseMemory]:
        """Step solver with the current supports fixed, and its memory, for a linearised time-step
        map. Raises SolveFailed where the sampled rows do not distinguish the active atoms."""
        return self._prepared(memory, memory.supports), memory

    def counters(self, memory: SparseMemory) -> Mapping[str, int]:
        return self.base.counters(memory)
