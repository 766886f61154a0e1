"""Adaptive time stepping by step doubling: each output step is subdivided until its error is small.

The output step H = `time.step` stays the interval of outputs, snapshots and checkpoints. A
controlled step is solved with 2^k substeps of H/2^k and with 2^(k+1) of half the size, both from
the same state. The difference over (2^order - 1) estimates the error of the finer solution
(Richardson; Hairer, Norsett, Wanner 1993, doi 10.1007/978-3-540-78862-1, Sec. II.4), which is
accepted when every field is within its share of the tolerance; otherwise it becomes the coarser one
of the next attempt. The next step starts from the last k.

An output step in which a load declares jumps (core/protocols/step_amplitude.py) is cut there, and
each part is controlled like an output step of its own size. The part that ends at a jump sees the
limit of the loads from the left. Its last substep is then solved again with the limit from the
right, and with the loads a little later: the rates of these solutions, and their slope, are those
with which the next part begins, so that it need not wait for the integrator's history to follow.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, inf, log2, sqrt
from typing import Any, NamedTuple, Self

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.integrator import (
    Integrator,
    NextStep,
    State,
    StepFormula,
    StepOutcome,
    advanced,
    next_time,
    same_time,
    with_history,
)
from sparsemor.core.protocols.layout import Block
from sparsemor.core.protocols.reducer import OfflineProducts
from sparsemor.core.protocols.step_amplitude import Substep, after, before, substep
from sparsemor.core.protocols.step_solver import (
    AroundSteps,
    ResultantSource,
    StepMemory,
    StepSolver,
)
from sparsemor.core.protocols.time_function import TimeFunction
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.scene.scene import Scene
from sparsemor.core.scene.sections import Control
from sparsemor.core.simulation.time_stepping import FixedStep, Step, loads_of, problem_of
from sparsemor.core.status import Status

MOST_CUTS = 8
"""Largest number of kinks of loads at which one output step is cut; it is cut at all jumps."""
SIZES = 16
"""Number of step solvers for parts of output steps that are kept."""
LATER = 1e-2
"""Distance of the later loads from a jump, relative to the last substep."""
JUMP = 1e-12
"""Relative change of a function that is a jump."""


def controlled(
    scene: Scene, model: Model, offline: OfflineProducts, solver: StepSolver
) -> StepSolver:
    """Step solver of a run: `solver` itself, or with `time.control` a solver of output steps that
    takes substeps with it and with solvers for smaller steps."""
    clock = scene.time
    if clock.control is None:
        return solver

    def prepare(h: float) -> StepSolver:
        made: StepSolver = scene.reducer.prepare(problem_of(scene, model, offline, h))
        return made

    return ControlledSteps(solver, scene.integrator, clock.step, clock.end, clock.control, prepare,
                           [*scene.functions_of_time.values()])


def step_of(solver: StepSolver, integrator: Integrator, h: float) -> Step:
    """Step function of a run from one output time to the next, h (s) later."""
    if isinstance(solver, ControlledSteps):
        return solver.step
    return FixedStep.of(integrator, solver, h)


class ControlMemory(StepMemory):
    """Data that an error-controlled run carries from one output step H to the next.

    levels: k -> memory of the step solver for substeps of H/2^k; solvers: k -> that solver,
    prepared when it is first needed; initial: full-order initial state.

    level: k of the coarser solution that the next step begins with; fine: k whose integrator
    history the state has; live: levels whose solvers ended at the last accepted state. origin:
    initial unknowns; changes: largest change of each block since the start (norm of `Judged`).
    restart: True where the history that the state has is of no use, as after a jump; slope (n,): of
    the highest rates, from which another one is made; parts: size
    (s) -> solver for substeps of parts of an output step.

    For the summary: substeps, solved: numbers of accepted substeps, and of all that were solved;
    rejected: number of rejected solutions; smallest, largest: sizes of accepted substeps, s; error:
    largest estimate over its share of the tolerance.
    """

    def __init__(
        self, base: StepMemory, origin: FloatArray, solver: StepSolver, initial: State
    ) -> None:
        """base: memory of `solver`, that of whole output steps; origin (n,): its initial unknowns;
        initial: full-order initial state. levels, solvers: by the number k of halvings of the step;
        level, fine: k with which the next step begins, and of the present state; the others: as in
        the class."""
        self.levels: dict[int, StepMemory] = {0: base}
        self.solvers, self.initial = {0: solver}, initial
        self.level, self.fine, self.live = 0, 0, frozenset({0})
        self.origin = origin
        self.changes: dict[str, float] = {}
        self.substeps, self.solved, self.rejected = 0, 0, 0
        self.smallest, self.largest = inf, 0.0
        self.error, self.restart = 0.0, False
        self.slope = np.zeros(len(origin))
        self.parts: dict[float, StepSolver] = {}

    def __getstate__(self) -> dict[str, Any]:
        state = dict(self.__dict__)
        del state["solvers"], state["initial"], state["parts"]
        return state

    def copy(self) -> Self:
        """Independent copy of this memory; solvers do not change and are shared."""
        other = self.__class__.__new__(self.__class__)
        other.__dict__.update(
            self.__dict__, levels={k: m.copy() for k, m in self.levels.items()},
            solvers=dict(self.solvers), changes=dict(self.changes), parts=dict(self.parts))
        return other


class _Part(NamedTuple):
    """Part of an output step between two times, s. whole: True for an output step in one part;
    kink, jump: True where the slope or value of a load jumps at its end."""

    start: float
    end: float
    whole: bool
    kink: bool
    jump: bool

    @property
    def size(self) -> float:
        return self.end - self.start


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
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
        """The norm of the block in a vector x (n,) of all unknowns of the step."""
        d = x[self.at]
        square = d.dot(d) if self.gram is None else d.dot(self.gram.dot(d))
        return sqrt(max(float(square), 0.0) / self.n)

    def norms(self, x: FloatArray) -> FloatArray:
        """The norms of several vectors, the rows of x."""
        d = x[:, self.at]
        squares = (d * (d if self.gram is None else d.dot(self.gram))).sum(axis=1)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0) / self.n))


class ControlledSteps(AroundSteps[StepSolver]):
    """Step solver of the output step H with error control, over step solvers of H, H/2, H/4, ...,
    each prepared when it is first needed.

    prepare: step size (s) -> step solver; end: end time of the run, s; functions: of time, at whose
    jumps substeps end.
    """

    def __init__(
        self, base: StepSolver, integrator: Integrator, h: float, end: float, control: Control,
        prepare: Callable[[float], StepSolver], functions: Sequence[TimeFunction] = (),
    ) -> None:
        super().__init__(base)
        self.functions = functions
        self.integrator, self.h, self.control = integrator, h, control
        self.share = control.tolerance * h / end
        self._prepare = prepare
        self.judged = tuple(
            judged(b, base, control) for b in base.layout.differential)

    def resultant_sources(self, memory: ControlMemory | None) -> tuple[ResultantSource, ...]:
        if memory is None:
            return self.base.resultant_sources(None)
        return self._solver(memory.fine, memory).resultant_sources(
            memory.levels[memory.fine])

    def start(self, state: State) -> tuple[State, ControlMemory]:
        reduced, memory = self.base.start(state)
        complete(memory, StepMemory, self.base, "start", "reducer")
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
        return _summed(self._solver(level, memory).counters(inner)
                       for level, inner in memory.levels.items())

    def linear_iterations(self, memory: ControlMemory) -> Mapping[str, int]:
        return _summed(self._solver(level, memory).linear_iterations(inner)
                       for level, inner in memory.levels.items())

    def summary(self, memory: ControlMemory) -> dict[str, Any]:
        """Summary of step control. Step sizes in s; `largest_error`: largest error estimate over
        its share of the tolerance, at most 1."""
        used = memory.substeps > 0
        return {
            "tolerance": self.control.tolerance, "substeps": memory.substeps,
            "substeps_for_estimates": memory.solved - memory.substeps, "rejected": memory.rejected,
            "smallest_step": memory.smallest if used else None,
            "largest_step": memory.largest if used else None,
            "prepared": len(memory.levels), "largest_error": memory.error,
        }

    def step(self, state: State, memory: ControlMemory) -> tuple[StepOutcome, State, ControlMemory]:
        """One output step with as many substeps as its tolerance needs; the outcome reports a
        failure if `max_halvings` does not suffice."""
        iterations, remaining, now = 0, 0.0, state
        for part in self._parts(state.t):
            outcome, now = self._controlled(part, now, memory)
            iterations += outcome.iterations
            remaining = max(remaining, outcome.remaining)
            outcome = replace(outcome, iterations=iterations, remaining=remaining)
            if not outcome.status.ok:
                return outcome, state, memory
        return outcome, now, memory

    def _parts(self, t: float) -> Sequence[_Part]:
        """Parts of the output step that begins at t, s, between the jumps of the loads."""
        end = next_time(t, self.h)
        close = same_time(end)
        found: dict[float, bool] = {}  # time, s -> True for a jump of the value, False for a kink
        for f in self.functions:
            for s in f.jumps(t + 2.0 * close, end + close) or ():
                # jumps of several loads at one time are one cut, also at the end of the step
                at = next((s0 for s0 in found if abs(s0 - s) <= close), s)
                at = end if abs(at - end) <= close else at
                old, new = before(f, s, (s,)), after(f, s)
                jump = abs(new - old) > JUMP * max(abs(new), abs(old))
                found[at] = found.get(at, False) or jump
        if len(found) > MOST_CUTS:  # kinks alone are left to the error estimate
            found = {s: jump for s, jump in found.items() if jump}
        edges = [t, *sorted({*found, end})]
        return [_Part(a, b, len(edges) == 2, b in found, found.get(b, False))
                for a, b in zip(edges, edges[1:], strict=False)]

    def _controlled(
        self, part: _Part, state: State, memory: ControlMemory
    ) -> tuple[StepOutcome, State]:
        """Solution of one part of a step, in 2^level and in 2^(level + 1) substeps; the level rises
        until both differ by less than the tolerance."""
        level, most = memory.level, self.control.max_halvings
        if not part.whole:  # substeps about as long as those of a whole step
            level = max(0, level + ceil(log2(part.size / self.h)))
        coarse = self._march(part, level, state, memory)
        while True:
            fine = self._march(part, level + 1, state, memory)
            # largest estimated error over its share of the tolerance
            error, block = self._error(coarse, fine, state, memory)
            if error <= 1.0:
                return self._accepted(part, fine, memory, level, error)
            memory.rejected += 1
            if level + 1 >= most:
                return self._refused(fine, error, block), state
            level, coarse = level + 1, fine  # the finer solution is the next coarse one

    def _accepted(
        self, part: _Part, fine: "_Try", memory: ControlMemory, level: int, error: float
    ) -> tuple[StepOutcome, State]:
        """Takes the finer solution, of level + 1, and chooses the level of the next step. error:
        its estimate over its share of the tolerance, at most 1. In `memory`, fine: level with the
        integrator history of the state; live: levels whose solvers ended at it."""
        memory.substeps += 2 ** (level + 1)
        size = fine.h
        memory.smallest, memory.largest = min(memory.smallest, size), max(memory.largest, size)
        memory.error = max(memory.error, error)
        for b in self.judged:
            memory.changes[b.name] = max(
                memory.changes.get(b.name, 0.0), b.norm(fine.state.x - memory.origin))
        if part.whole:
            memory.fine, memory.live = level + 1, frozenset({level, level + 1})
            # one level up the estimate is 2^order times as large: take half of that as safe
            easy = error <= 0.5 / 2**self.integrator.order
            memory.level = level - 1 if easy and level > 0 else level
        memory.restart = part.kink or not part.whole
        if memory.restart:
            memory.live = frozenset()
        state, memory.slope = self._after(part, fine)
        return fine.outcome, state

    def _after(self, part: _Part, fine: "_Try") -> tuple[State, FloatArray]:
        """State after a part, and slope of its highest rates: where loads have a kink or a jump,
        those of the last substep, solved with the loads after it. fine.last: solver, formula and
        memory of that substep."""
        (solver, step, inner), layout, h = fine.last, self.layout, fine.h
        second, first = layout.second, layout.first
        slope = np.zeros(layout.size)

        def by_rates(old: State, new: State, t: float) -> None:
            slope[second] = (new.a - old.a)[second] / t
            slope[first] = (new.v - old.v)[first] / t

        if not part.kink:
            by_rates(fine.previous, fine.state, h)
            return fine.state, slope
        # the same substep with the loads just after its end, and a little later: rates and slope
        rules, found = self.integrator.rules(h), []
        for later in (0.0, LATER * h):
            with substep(Substep(h, after=later)):
                outcome, _ = solver.solve(step, inner.copy())
            if not outcome.status.ok:
                return fine.state, slope
            found.append(advanced(rules, layout, fine.state, step, outcome))
        by_rates(found[0], found[1], LATER * h)
        v = fine.state.v.copy()
        v[first] = found[0].v[first]  # jumps where a prescribed temperature has a kink
        return replace(fine.state, v=v, a=found[0].a if part.jump else fine.state.a), slope

    def _refused(self, fine: "_Try", error: float, block: str) -> StepOutcome:
        """Outcome of a step whose finest substeps failed, or have `error` times their share of the
        tolerance in a block."""
        if not fine.outcome.status.ok:
            return fine.outcome
        h = self.h / 2**self.control.max_halvings
        size = "has no estimate" if error == inf else f"is {error:.2g} times its share"
        detail = (f"its error {size} of time.control.tolerance {self.control.tolerance:g} with "
                  f"substeps of {h:.3g} s, after max_halvings {self.control.max_halvings}")
        return replace(fine.outcome, status=Status.STEP_TOO_LONG, block=block, detail=detail)

    def _march(self, part: _Part, level: int, state: State, memory: ControlMemory) -> "_Try":
        """Solution of a part with 2^level substeps from `state`; updates `memory.levels[level]` for
        whole output steps. In `memory`, fine: level with the integrator history of `state`; live:
        levels whose solver ended at `state`, to which others are moved."""
        h, layout = part.size / 2**level, self.layout
        restart = memory.restart or not part.whole or level != memory.fine
        if part.whole:
            h, solver = self.h / 2**level, self._solver(level, memory)
            if level not in memory.levels:
                memory.levels[level] = solver.start(memory.initial)[1]
            inner = memory.levels[level]
            if level not in memory.live:
                inner.moved(state.x)
            memory.live = memory.live - {level}  # ended elsewhere, unless this try is accepted
        else:
            solver = self._of_size(h, memory)
            inner = solver.start(memory.initial)[1]
            inner.moved(state.x)
        if restart:  # a history of other steps, or before a jump: begin again from x, v, a
            state = with_history(self.integrator, layout, state, memory.slope, h)
        rules, iterations, remaining, previous = self.integrator.rules(h), 0, 0.0, state
        last: StepFormula | None = None

        def solve(formula: StepFormula) -> StepOutcome:
            nonlocal inner, last
            with substep(own):
                outcome, inner = solver.solve(formula, inner)
            last = formula
            return outcome

        for i in range(1, 2**level + 1):
            own = loads_of(self.integrator, h, restart and i == 1)
            end = part.end if i == 2**level else next_time(state.t, h)
            outcome, new = self.integrator.advance(
                solve, NextStep(rules, layout, state, h, end))
            iterations += outcome.iterations
            remaining = max(remaining, outcome.remaining)
            if not outcome.status.ok:
                break
            previous, state = state, new
        assert last is not None
        if part.whole:
            memory.levels[level] = inner
        memory.solved += 2**level
        outcome = replace(outcome, iterations=iterations, remaining=remaining)
        return _Try(outcome, state, h, (solver, last, inner), previous)

    def _error(
        self, coarse: "_Try", fine: "_Try", state: State, memory: ControlMemory
    ) -> tuple[float, str]:
        """Largest ratio of estimated error to its share of the tolerance, and the block where it
        occurs; infinite where a solution failed. The error of the finer solution of order p is
        |x_fine - x_coarse| / (2^p - 1), relative to the largest change of the block since the
        start, or to its reference size where that is larger."""
        if not (coarse.outcome.status.ok and fine.outcome.status.ok):
            return inf, fine.outcome.block or coarse.outcome.block
        richardson, worst = 2.0**self.integrator.order - 1.0, (0.0, "")
        for b in self.judged:
            moved = max(memory.changes.get(b.name, 0.0), b.norm(fine.state.x - memory.origin))
            error = b.norm(fine.state.x - coarse.state.x) / (richardson * max(b.size, moved))
            # true for what is not a number, too
            if not error / self.share <= worst[0]:
                worst = error / self.share, b.name
        return worst

    def _solver(self, level: int, memory: ControlMemory) -> StepSolver:
        """Solver for substeps of H / 2^level, prepared when it is first needed."""
        if level not in memory.solvers:
            memory.solvers[level] = self._prepare(self.h / 2**level)
        return memory.solvers[level]

    def _of_size(self, h: float, memory: ControlMemory) -> StepSolver:
        """Solver for substeps of h (s) of a part of an output step."""
        known = next((k for k in memory.parts if abs(k - h) <= 1e-13 * h), None)
        if known is None:
            while len(memory.parts) >= SIZES:
                memory.parts.pop(next(iter(memory.parts)))
            known, memory.parts[h] = h, self._prepare(h)
        return memory.parts[known]


def _summed(counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    """Sums of counts of the same name."""
    total = Counter[str]()
    for one in counts:
        total.update(one)
    return dict(total)


@dataclass(frozen=True, slots=True, eq=False)
class _Try:
    """Solution of a part of an output step with substeps of h, s; last: solver, formula and memory
    of the last one, which begins at `previous`."""

    outcome: StepOutcome
    state: State
    h: float
    last: tuple[StepSolver, StepFormula, StepMemory]
    previous: State


def judged(block: Block, solver: StepSolver, control: Control) -> Judged:
    """A block of a step solver whose error is measured. control: sizes of relative errors."""
    at, d = solver.layout[block.name], solver.dictionaries.get(block.name)
    gram = None if d is None else np.asarray(d.atoms.T @ d.atoms)
    n = at.stop - at.start if d is None else len(d.offset)
    return Judged(block.name, at, gram, n, control.size_of(block.kind))
