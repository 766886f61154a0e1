"""Adaptive time stepping by step doubling: each output step is subdivided until its error is small.

The output step H = `time.step` stays the interval of outputs, snapshots and checkpoints. A
controlled step is solved with 2^k substeps of H/2^k and with 2^(k+1) of half the size, both from
the same state. The difference over (2^order - 1) estimates the error of the finer solution
(Richardson; Hairer, Norsett, Wanner 1993, doi 10.1007/978-3-540-78862-1, Sec. II.4), which is
accepted when every field is within its share of the tolerance; otherwise it becomes the coarser one
of the next attempt. The next step starts from the last k.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import inf, sqrt
from typing import Any, Self

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import (
    CountsLinearIterations,
    Integrator,
    OfflineProducts,
    ReducedProblem,
    Restarts,
    State,
    StepFormula,
    StepOutcome,
    StepSolver,
)
from sparsemor.core.protocols.layout import Block
from sparsemor.core.protocols.step_solver import AroundSteps, ResultantSource, resultant_sources_of
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.scene.options import Control
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.time_stepping import FixedStep, Step, iterate
from sparsemor.core.status import Status


def controlled(
    scene: Scene, model: Model, offline: OfflineProducts, solver: StepSolver
) -> StepSolver:
    """Step solver of a run: `solver` itself, or with `time.control` a solver of output steps that
    takes substeps with it and with solvers for smaller steps."""
    clock = scene.time
    if clock.control is None:
        return solver

    def prepare(h: float) -> StepSolver:  # the same seed, so the same rows are drawn
        made: StepSolver = scene.reducer.prepare(ReducedProblem(
            model, scene.integrator, h, offline, np.random.default_rng(scene.seed)))
        return made

    return ControlledSteps(solver, scene.integrator, clock.step, clock.end, clock.control, prepare)


def step_of(solver: StepSolver, integrator: Integrator, h: float) -> Step:
    """Step function of a run from one output time to the next, h (s) later."""
    if isinstance(solver, ControlledSteps):
        return solver.step
    return FixedStep.of(integrator, solver, h)


class ControlMemory:
    """Data that an error-controlled run carries from one output step H to the next.

    levels: k -> memory of the step solver for substeps of H/2^k; solvers: k -> that solver,
    prepared when it is first needed; initial: full-order initial state.

    level: k of the coarser solution that the next step begins with; fine: k whose integrator
    history the state has; live: levels whose solvers ended at the last accepted state. origin:
    initial unknowns; moved: largest change of each block since the start (norm of `_Judged`).
    """

    def __init__(
        self, base: Restarts, origin: FloatArray, solver: StepSolver, initial: State
    ) -> None:
        self.levels: dict[int, Restarts] = {0: base}
        self.solvers, self.initial = {0: solver}, initial
        self.level, self.fine, self.live = 0, 0, frozenset({0})
        self.origin = origin
        self.moved: dict[str, float] = {}
        self.substeps, self.solved, self.rejected = 0, 0, 0
        self.smallest, self.largest = -1, 10**6
        self.error = 0.0

    def __getstate__(self) -> dict[str, Any]:
        state = dict(self.__dict__)
        del state["solvers"], state["initial"]
        return state

    def copy(self) -> Self:
        """Independent copy of this memory; solvers do not change and are shared."""
        other = self.__class__.__new__(self.__class__)
        other.__dict__.update(
            self.__dict__, levels={k: m.copy() for k, m in self.levels.items()},
            solvers=dict(self.solvers), moved=dict(self.moved))
        return other


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """Block whose error is controlled, with the norm sqrt(d^T gram d / n): root mean square of the
    n full-order unknowns.

    at: its unknowns in the vector of the step; gram: atoms^T atoms, None for a block that is not
    reduced; size: smallest reference size of relative errors, in the unit of the field.
    """

    name: str
    at: slice
    gram: FloatArray | None
    n: int
    size: float

    def norm(self, x: FloatArray) -> float:
        d = x[self.at]
        square = d.dot(d) if self.gram is None else d.dot(self.gram.dot(d))
        return sqrt(max(float(square), 0.0) / self.n)


class ControlledSteps(AroundSteps[StepSolver]):
    """Step solver of the output step H with error control, over step solvers of H, H/2, H/4, ...,
    each prepared when it is first needed.

    prepare: step size (s) -> step solver; end: end time of the run, s.
    """

    def __init__(
        self, base: StepSolver, integrator: Integrator, h: float, end: float, control: Control,
        prepare: Callable[[float], StepSolver],
    ) -> None:
        super().__init__(base)
        self.integrator, self.h, self.control = integrator, h, control
        self.share = control.tolerance * h / end
        self._prepare = prepare
        self.judged = tuple(
            _judged(b, base, control) for b in base.layout.differential)

    def resultant_sources(self, memory: ControlMemory | None) -> tuple[ResultantSource, ...]:
        if memory is None:
            return resultant_sources_of(self.base, None)
        return resultant_sources_of(self._solver(memory.fine, memory), memory.levels[memory.fine])

    def start(self, state: State) -> tuple[State, ControlMemory]:
        reduced, memory = self.base.start(state)
        complete(memory, Restarts, self.base, "start", "reducer")
        return reduced, ControlMemory(memory, reduced.x, self.base, state)

    def solve(
        self, step: StepFormula, memory: ControlMemory
    ) -> tuple[StepOutcome, ControlMemory]:
        """One step of the size that `step` has, without an error estimate."""
        outcome, memory.levels[0] = self.base.solve(step, memory.levels[0])
        return outcome, memory

    def supports(self, memory: ControlMemory) -> Mapping[str, BoolArray]:
        """Active atoms of each block, (k,) masks, in the finer solution of the last accepted
        step."""
        return self._solver(memory.fine, memory).supports(memory.levels[memory.fine])

    def counters(self, memory: ControlMemory) -> Mapping[str, int]:
        """Counts of events, such as factorizations, summed over the solvers of all substep
        sizes."""
        total: dict[str, int] = {}
        for level, inner in memory.levels.items():
            for name, count in self._solver(level, memory).counters(inner).items():
                total[name] = total.get(name, 0) + count
        return total

    def linear_iterations(self, memory: ControlMemory) -> Mapping[str, int]:
        found: dict[str, int] = {}
        for level, inner in memory.levels.items():
            solver = self._solver(level, memory)
            if not isinstance(solver, CountsLinearIterations):
                continue
            for name, count in solver.linear_iterations(inner).items():
                found[name] = found.get(name, 0) + count
        return found

    def summary(self, memory: ControlMemory) -> dict[str, Any]:
        """Summary of step control. Step sizes in s; `largest_error`: largest error estimate over
        its share of the tolerance, at most 1."""
        used = memory.substeps > 0
        return {
            "tolerance": self.control.tolerance, "substeps": memory.substeps,
            "substeps_for_estimates": memory.solved - memory.substeps, "rejected": memory.rejected,
            "smallest_step": self.h / 2**memory.smallest if used else None,
            "largest_step": self.h / 2**memory.largest if used else None,
            "prepared": len(memory.levels), "largest_error": memory.error,
        }

    def step(self, state: State, memory: ControlMemory) -> tuple[StepOutcome, State, ControlMemory]:
        """One output step with as many substeps as its tolerance needs; the outcome reports a
        failure if `max_halvings` does not suffice."""
        level, most = memory.level, self.control.max_halvings
        coarse = self._march(level, state, memory)
        while True:
            fine = self._march(level + 1, state, memory)
            error, block = self._error(coarse, fine, state, memory)
            if error <= 1.0:
                return self._accepted(fine, state, memory, level, error)
            memory.rejected += 1
            if level + 1 >= most:
                return self._refused(fine, error, block), state, memory
            level, coarse = level + 1, fine

    def _accepted(
        self, fine: "_Try", state: State, memory: ControlMemory, level: int, error: float
    ) -> tuple[StepOutcome, State, ControlMemory]:
        memory.fine, memory.live = level + 1, frozenset({level, level + 1})
        memory.substeps += 2 ** (level + 1)
        memory.smallest, memory.largest = (
            max(memory.smallest, level + 1), min(memory.largest, level + 1))
        memory.error = max(memory.error, error)
        for b in self.judged:
            memory.moved[b.name] = max(
                memory.moved.get(b.name, 0.0), b.norm(fine.state.x - memory.origin))
        # one level up the estimate is 2^order times as large: take half of that as safe
        easy = error <= 0.5 / 2**self.integrator.order
        memory.level = level - 1 if easy and level > 0 else level
        return fine.outcome, replace(fine.state, t=state.t + self.h), memory

    def _refused(self, fine: "_Try", error: float, block: str) -> StepOutcome:
        if not fine.outcome.status.ok:
            return fine.outcome
        h = self.h / 2**self.control.max_halvings
        seen = "has no estimate" if error == inf else f"is {error:.2g} times its share"
        detail = (f"its error {seen} of time.control.tolerance {self.control.tolerance:g} with "
                  f"substeps of {h:.3g} s, after max_halvings {self.control.max_halvings}")
        return replace(fine.outcome, status=Status.STEP_TOO_LONG, block=block, detail=detail)

    def _march(self, level: int, state: State, memory: ControlMemory) -> "_Try":
        """Solution with 2^level substeps from `state`; updates `memory.levels[level]`."""
        solver, h, layout = self._solver(level, memory), self.h / 2**level, self.layout
        if level not in memory.levels:
            memory.levels[level] = solver.start(memory.initial)[1]
        inner = memory.levels[level]
        if level not in memory.live:
            inner.moved(state.x)
        if level != memory.fine:  # a history of other steps: begin again from x, v, a
            state = self.integrator.start(layout, state)
        memory.live = memory.live - {level}  # unless this try is accepted
        step, iterations, left = FixedStep.of(self.integrator, solver, h), 0, 0.0
        for taken in iterate(step, state, inner, 2**level):
            iterations += taken.outcome.iterations
            left = max(left, taken.outcome.remaining)
        memory.levels[level] = taken.memory
        memory.solved += 2**level
        outcome = replace(taken.outcome, iterations=iterations, remaining=left)
        return _Try(outcome, taken.state)

    def _error(
        self, coarse: "_Try", fine: "_Try", state: State, memory: ControlMemory
    ) -> tuple[float, str]:
        """Largest ratio of estimated error to its share of the tolerance, and the block where it
        occurs."""
        if not (coarse.outcome.status.ok and fine.outcome.status.ok):
            return inf, fine.outcome.block or coarse.outcome.block
        richardson, worst = 2.0**self.integrator.order - 1.0, (0.0, "")
        for b in self.judged:
            moved = max(memory.moved.get(b.name, 0.0), b.norm(fine.state.x - memory.origin))
            error = b.norm(fine.state.x - coarse.state.x) / (richardson * max(b.size, moved))
            # true for what is not a number, too
            if not error / self.share <= worst[0]:
                worst = error / self.share, b.name
        return worst

    def _solver(self, level: int, memory: ControlMemory) -> StepSolver:
        if level not in memory.solvers:
            memory.solvers[level] = self._prepare(self.h / 2**level)
        return memory.solvers[level]


@dataclass(frozen=True, slots=True, eq=False)
class _Try:
    outcome: StepOutcome
    state: State


def _judged(block: Block, solver: StepSolver, control: Control) -> _Judged:
    at, d = solver.layout[block.name], solver.dictionaries.get(block.name)
    gram = None if d is None else np.asarray(d.atoms.T @ d.atoms)
    n = at.stop - at.start if d is None else len(d.offset)
    return _Judged(block.name, at, gram, n, control.size_of(block.kind))
