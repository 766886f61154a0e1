"""Successive steps from a state: integrator formula, solution of the step's equations, update of
the state. Runs record them (run_steps.py)."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeAlias

import numpy as np
from typing_extensions import TypeVar

from sparsemor.core.arrays import FloatArray
from sparsemor.core.linalg.dense import least_squares_coefficients
from sparsemor.core.protocols.integrator import (
    Integrator,
    NextStep,
    State,
    StepFormula,
    StepOutcome,
    UpdateRules,
    next_time,
)
from sparsemor.core.protocols.reducer import AssembledModel, OfflineProducts, ReducedProblem
from sparsemor.core.protocols.step_amplitude import Substep, substep
from sparsemor.core.protocols.step_solver import ManySteps, StepMemory, StepSolver
from sparsemor.core.scene.scene import Scene
from sparsemor.core.status import SolveFailed, Status

UNRESOLVED = 100.0
"""Largest ratio of the accelerations of a reduced start to those of the full-order one."""

M = TypeVar("M", bound=StepMemory, default=Any)


class TimeStep(NamedTuple, Generic[M]):
    """Result of one time step: outcome, and state and memory (solver data carried from step to
    step) after it. The state of a failed step is the one that it started from. seconds: wall-clock
    time of the step; whole: False where the memory is that after later steps of the same block."""

    outcome: StepOutcome
    state: State
    memory: M
    seconds: float
    whole: bool = True


Step: TypeAlias = Callable[[State, M], tuple[StepOutcome, State, M]]
"""Function of one time step: state and memory -> outcome, and both after the step, as in
`TimeStep`."""


@dataclass(frozen=True, slots=True, eq=False)
class FixedStep(Generic[M]):
    """Time step of size h (s): the integrator's rules express the unknowns by their highest rates,
    then the solver determines these. loads: step over which loads are averaged."""

    integrator: Integrator
    rules: UpdateRules
    solver: StepSolver[M]
    h: float
    loads: Substep

    @classmethod
    def of(cls, integrator: Integrator, solver: StepSolver[M], h: float) -> "FixedStep[M]":
        return cls(integrator, integrator.rules(h), solver, h, loads_of(integrator, h))

    def __call__(self, state: State, memory: M) -> tuple[StepOutcome, State, M]:
        """Outcome, state and memory after a step from `state`."""
        solver, own = self.solver, self.loads

        def solve(formula: StepFormula) -> StepOutcome:
            nonlocal memory
            with substep(own):
                outcome, memory = solver.solve(formula, memory)
            return outcome

        step = NextStep(
            self.rules, solver.layout, state, self.h, next_time(state.t, self.h))
        outcome, state = self.integrator.advance(solve, step)
        return outcome, state, memory


def problem_of(
    scene: Scene, model: AssembledModel, offline: OfflineProducts, h: float | None = None
) -> ReducedProblem:
    """Problem of a time step of h, s (by default that of the scene), from which the reducer of the
    scene prepares a step solver; the same seed, so the same rows are drawn."""
    return ReducedProblem(model, scene.integrator, h or scene.time.step, offline,
                          np.random.default_rng(scene.seed))


def loads_of(integrator: Integrator, h: float, begins: bool = False) -> Substep:
    """The step of h (s) over which loads are averaged; an integrator with several solves has them
    at the time of each."""
    return Substep(h, begins) if integrator.one_solve else Substep(0.0)


def started(solver: StepSolver[M], integrator: Integrator, full: State) -> tuple[State, M]:
    """Initial state in the solver's (reduced) unknowns with the integrator's history, and the
    solver's initial memory; full: full-order initial state. Accelerations that this one does not
    have, because the step does not resolve them (`resolved_start`), are not made again."""
    state, memory = solver.start(full)
    if _larger(state.a, full.a) and _larger(state.a, resolved := _accelerations(solver, full)):
        state = replace(state, a=resolved)
    return integrator.start(solver.layout, state), memory


def full_state(solver: StepSolver, state: State) -> State:
    """State in full-order unknowns, without the integrator's memory."""
    x, v, a = [], [], []
    for b in solver.layout:
        at, d = solver.layout[b.name], solver.dictionaries.get(b.name)
        x.append(state.x[at] if d is None else d.offset + d.atoms @ state.x[at])
        v.append(state.v[at] if d is None else d.atoms @ state.v[at])
        a.append(state.a[at] if d is None else d.atoms @ state.a[at])
    whole = np.concatenate(x)
    return State(state.t, whole, np.concatenate(v), np.concatenate(a), np.zeros((len(whole), 0)))


def _larger(a: FloatArray, resolved: FloatArray) -> bool:
    """True if accelerations exceed those that the step resolves."""
    return float(np.abs(a).max(initial=0.0)) > UNRESOLVED * float(np.abs(resolved).max(initial=0.0))


def _accelerations(solver: StepSolver[M], full: State) -> FloatArray:
    """Accelerations of a full-order state, in the solver's unknowns."""
    bases, layout = solver.dictionaries, solver.layout
    whole = layout.resized({name: len(d.offset) for name, d in bases.items()})
    if whole.size != len(full.a):  # a model without mesh: already in its unknowns
        return full.a
    a = np.zeros(layout.size)
    for b in layout:
        there, d = full.a[whole[b.name]], bases.get(b.name)
        a[layout[b.name]] = there if d is None else least_squares_coefficients(
            d.atoms, there[:, None])[:, 0]
    return a


def iterate(
    step: Step[M], state: State, memory: M, count: int,
    interrupted: Callable[[], bool] = lambda: False, many: ManySteps[M] | None = None,
) -> Iterator[TimeStep[M]]:
    """Up to `count` successive time steps, in blocks by `many` where it can. Ends after the first
    one that fails, which is included, or before a step or block if `interrupted()` is true."""
    for block in in_blocks(step, state, memory, count, interrupted, many):
        yield from block


def in_blocks(
    step: Step[M], state: State, memory: M, count: int,
    interrupted: Callable[[], bool] = lambda: False, many: ManySteps[M] | None = None,
) -> Iterator[Sequence[TimeStep[M]]]:
    """The time steps of `iterate`, those of one call of `many` together."""
    while count > 0:
        if interrupted():
            return
        begun = time.perf_counter()
        block = None if many is None else many.advance(state, memory, count)
        if block is not None and (done := len(block)):
            each = (time.perf_counter() - begun) / done
            states = [block.state(i) for i in range(done)]
            # the memory is that after the last step of the block, for which alone `whole` is True
            yield [TimeStep(StepOutcome(s.x, Status.DONE, n, remaining=error), s, memory, each,
                            i == done) for i, (s, n, error) in enumerate(zip(
                                states, block.iterations, block.remaining, strict=True), 1)]
            state = states[-1]
            count -= done
            continue
        outcome, state, memory = step(state, memory)
        yield [TimeStep(outcome, state, memory, time.perf_counter() - begun)]
        if not outcome.status.ok:
            return
        count -= 1


def many_steps(
    solver: StepSolver[M], integrator: Integrator, h: float, steps: int
) -> ManySteps[M] | None:
    """The solver's way to take several steps of size h, s, in one call; None where it has none."""
    if not integrator.one_solve:
        return None
    return solver.many(integrator.rules(h), h, steps)


def accepted_steps(
    step: Step[M], state: State, memory: M, count: int, h: float
) -> Iterator[TimeStep[M]]:
    """Successive time steps as in `iterate`; a step of h (s) that fails raises SolveFailed."""
    for taken in iterate(step, state, memory, count):
        outcome = taken.outcome
        if not outcome.status.ok:
            raise SolveFailed(outcome.status, taken.state.t + h, outcome.block, outcome.detail)
        yield taken
