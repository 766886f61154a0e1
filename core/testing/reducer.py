"""Law kit of a reducer and its step solver, on a scene small enough to run many times."""

import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Condition
from types import FrameType
from typing import Any

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols.integrator import State, StepFormula, StepOutcome
from sparsemor.core.protocols.reducer import ReducedProblem
from sparsemor.core.protocols.step_solver import AroundSteps, StepMemory, StepSolver
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.checkpoint import Saved, SavedError
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.time_stepping import FixedStep, Step, iterate, started
from sparsemor.core.simulation.training import train
from sparsemor.core.testing.random_inputs import keeps_contract, law

Run = Callable[[], FloatArray]
AHEAD = 2
"""Number of steps by which one of two threads is ahead of the other."""
EVERY = 3
"""Number of function calls after which a thread lets the other one run."""


def check_reducer(scene: Scene, seed: int = 0, steps: int = 6) -> None:
    """Laws of a reducer: its unknowns are those of its dictionaries; steps change none of their
    arguments; the step memory (data carried from step to step) can be copied, stored and continued
    from; equal seeds give equal numbers, in one thread and in two.

    The training run of the scene is a full-order run, so the scene should be short.
    """
    keeps_contract("reducer", scene.reducer)
    model = assemble(scene)
    snapshots = {n: s.T for n, s in train(scene.for_training(), new_manager()).items()}
    solver = _prepared(scene, model, snapshots, seed)
    _solver(solver, model)
    if not scene.reducer.restart_refusal():
        memory = solver.start(consistent_state(model))[1]
        law(memory.restarts,
            "the reducer has `restart_refusal`, and its memory no moved(x)")
    first = _march(scene, model, _Checked(solver), steps)
    again = _march(scene, model, _prepared(scene, model, snapshots, seed), steps)
    law(np.array_equal(first, again), f"two runs of one seed differ (seed {seed})")
    for how in ("stored", "copied"):
        resumed = _march(scene, model, solver, steps, how)
        law(np.array_equal(first, resumed),
            f"a run that is continued from its {how} memory differs (seed {seed})")
    one, other = two_runs(FixedStep.of(scene.integrator, solver, scene.time.step),
                          *started(solver, scene.integrator, consistent_state(model)), steps)
    alone, both = (one(), other()), in_two_threads(one, other)
    law(all(np.array_equal(*pair) for pair in zip(alone, both, strict=True)),
        "two threads that step one solver, each with its memory, differ from one thread: the "
        "solver keeps something that a step writes to")


def two_runs(step: Step, state: State, memory: Any, count: int) -> tuple[Run, Run]:
    """Two runs of `count` steps, from this state and from `AHEAD` steps later, each on a copy of
    its step memory; each returns its states (count, n)."""
    def run(state: State, memory: Any) -> Run:
        @np.errstate(all="ignore")  # each thread has its own; overflow is a status of the step
        def states() -> FloatArray:
            return np.array([one.state.x for one in iterate(step, state, memory.copy(), count)])

        return states

    for one in iterate(step, state, memory.copy(), AHEAD):
        later = one
    return run(state, memory), run(later.state, later.memory)


class Turns:
    """Scheduler of two threads that run in turns, never both at once.

    A thread lets the other one run at every `EVERY`-th function call, so that data that both write
    are overwritten between writing and reading, at the same places in each run. The threads must
    compute different numbers: equal ones overwrite each other without effect.

    turn: number of the thread that may run; running: those that have not ended.
    """

    def __init__(self) -> None:
        self.changed, self.turn, self.running = Condition(), 0, {0, 1}

    def run(self, me: int, what: Run) -> FloatArray:
        """Runs `what` as thread number `me` (0 or 1), which lets the other one run at every
        `EVERY`-th function call, and returns its result."""
        calls = 0

        def count(frame: FrameType, event: str, arg: object) -> None:
            nonlocal calls
            calls += event in ("call", "c_call")
            if calls >= EVERY:
                calls = 0
                self._pass_on(me)

        with self.changed:
            self.changed.wait_for(lambda: self.turn == me, timeout=1.0)
        sys.setprofile(count)
        try:
            return what()
        finally:
            sys.setprofile(None)
            with self.changed:
                self.running.discard(me)
                self.changed.notify_all()

    def _pass_on(self, me: int) -> None:
        with self.changed:
            self.turn = 1 - me
            self.changed.notify_all()
            # not for ever: the other one may wait for a lock that this one holds
            self.changed.wait_for(
                lambda: self.turn == me or 1 - me not in self.running, timeout=0.1)


def in_two_threads(first: Run, second: Run) -> tuple[FloatArray, FloatArray]:
    """Results of two runs in two threads that alternate at function calls."""
    turns = Turns()
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.submit(turns.run, 0, first), pool.submit(turns.run, 1, second)
        return one.result(), other.result()


def _prepared(
    scene: Scene, model: Model, snapshots: dict[str, FloatArray], seed: int
) -> StepSolver:
    solver: StepSolver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, Offline.from_snapshots(model, snapshots),
        np.random.default_rng(seed)))
    return solver


@np.errstate(all="ignore")  # each thread has its own; overflow is a status of the step
def _march(scene: Scene, model: Model, solver: StepSolver, steps: int, how: str = "") -> FloatArray:
    """States (steps, n) of a run. how: memory with which the second half continues: "stored":
    written as plain data and read again; "copied": a copy made before a step is tried with the
    original; "": the memory itself."""
    h, kept = scene.time.step, list[FloatArray]()
    step = FixedStep.of(scene.integrator, solver, h)
    state, memory = started(solver, scene.integrator, consistent_state(model))
    for count in (steps // 2, steps - steps // 2):
        for taken in iterate(step, state, memory, count):
            outcome, state, memory = taken.outcome, taken.state, taken.memory
            law(outcome.status.ok,
                f"step {len(kept) + 1} ended {outcome.status.value} in {outcome.block}")
            kept.append(state.x.copy())
        if how == "stored":
            memory = _restored(solver, model, memory)
        elif how == "copied":
            original, memory = memory, memory.copy()
            step(state, original)
    return np.array(kept)


@dataclass(frozen=True, eq=False)
class _Checked(AroundSteps[StepSolver]):
    """Step solver that checks every outcome of another one."""

    def start(self, state: State) -> tuple[State, StepMemory]:
        reduced, memory = self.base.start(state)
        law(isinstance(memory, StepMemory), "the memory has no copy()")
        return reduced, memory

    def solve(self, step: StepFormula, memory: StepMemory) -> tuple[StepOutcome, StepMemory]:
        """A step of the solver, with checks that it leaves its argument as it is and returns finite
        values."""
        before = step.free.copy(), step.free_rate.copy()
        outcome, memory = self.base.solve(step, memory)
        after = step.free, step.free_rate
        law(all(np.array_equal(a, b) for a, b in zip(before, after, strict=True)),
            "solve wrote to its argument `step`")
        law(outcome.x.shape == (self.layout.size,), f"x has shape {outcome.x.shape}")
        law(not outcome.status.ok or bool(np.isfinite(outcome.x).all()),
            "status done with values that are not finite")
        law(outcome.iterations >= 1, "a step takes at least one iteration")
        _memory(self.base, memory)
        return outcome, memory

    def supports(self, memory: StepMemory) -> Mapping[str, BoolArray]:
        return self.base.supports(memory)

    def counters(self, memory: StepMemory) -> Mapping[str, int]:
        return self.base.counters(memory)


def _restored(solver: StepSolver, model: Model, memory: StepMemory) -> StepMemory:
    """Step memory as a resumed run gets it: written as plain data, and read into the memory of the
    start."""
    try:
        stored = Saved.from_value(memory).dump()
        restored: StepMemory = Saved.load(stored).into(solver.start(consistent_state(model))[1])
        return restored
    except (TypeError, SavedError) as error:
        raise AssertionError(f"the memory cannot be stored and read again: {error}") from None


def _solver(solver: StepSolver, model: Model) -> None:
    """Checks blocks, dictionaries, rows, notes and facts of a step solver against its model."""
    full = {b.name: b.size for b in model.layout}
    own = {b.name: b.size for b in solver.layout}
    law(list(own) == list(full), "the blocks differ from the model's")
    for name, size in own.items():
        d = solver.dictionaries.get(name)
        if d is None:
            law(size == full[name], f"{name} has another size and no dictionary")
            continue
        law(d.atoms.shape == (full[name], size), f"{name}: atoms {d.atoms.shape}")
        law(d.offset.shape == (full[name],), f"{name}: offset {d.offset.shape}")
    for name, rows in solver.rows.items():
        law(bool(np.all(np.diff(rows) > 0)) and rows.max(initial=0) < full[name],
            f"{name}: rows are not sorted, distinct and inside the block")
    law(all(n >= 0 for n in solver.elements_touched.values()), "elements_touched is negative")
    law(all(isinstance(n, Note) and n.text for n in solver.notes), "a note has no text")
    law(all(isinstance(v, float | int | str) for f in solver.facts.values() for v in f.values()),
        "facts may hold numbers and strings only")


def _memory(solver: StepSolver, memory: StepMemory) -> None:
    for name, support in solver.supports(memory).items():
        at = solver.layout[name]
        law(support.shape == (at.stop - at.start,) and support.dtype == np.bool_,
            f"{name}: support must be bool of the block's size")
    law(all(isinstance(n, int) and n >= 0 for n in solver.counters(memory).values()),
        "counters must be integers")
