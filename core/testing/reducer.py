"""Laws of a reducer and its step solver, on a scene small enough to run many times."""

import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Barrier

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols import (
    ReducedProblem,
    State,
    StepFormula,
    StepMemory,
    StepOutcome,
    StepSolver,
)
from sparsemor.core.protocols.step_solver import AroundSteps
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.saved_state import Saved, SavedError
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline, train
from sparsemor.core.simulation.time_stepping import FixedStep, iterate, started
from sparsemor.core.testing.random_inputs import law


def check_reducer(scene: Scene, seed: int = 0, steps: int = 6) -> None:
    """The scene's reducer: unknowns that its dictionaries explain, steps that change none of their
    arguments, memory that can be copied, stored and continued from, equal numbers for equal seeds
    and in two threads.

    The scene is trained by its own full-order run, so keep it short.
    """
    model = assemble(scene)
    snapshots = {n: s.T for n, s in train(scene.for_training(), new_manager()).items()}
    solver = _prepared(scene, model, snapshots, seed)
    _solver(solver, model)
    first = _march(scene, model, _Checked(solver), steps)
    again = _march(scene, model, _prepared(scene, model, snapshots, seed), steps)
    law(np.array_equal(first, again), f"two runs of one seed differ (seed {seed})")
    for how in ("stored", "copied"):
        resumed = _march(scene, model, solver, steps, how)
        law(np.array_equal(first, resumed),
            f"a run that is continued from its {how} memory differs (seed {seed})")
    both = in_two_threads(lambda: _march(scene, model, solver, steps))
    law(all(np.array_equal(first, one) for one in both),
        "two threads that step one solver, each with its memory, differ from one thread: the "
        "solver keeps something that a step writes to")


def in_two_threads(run: Callable[[], FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Results of two runs at once, which the interpreter changes between as often as it can."""
    interval, begin = sys.getswitchinterval(), Barrier(2)

    def one() -> FloatArray:
        begin.wait()
        return run()

    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            first, second = pool.submit(one), pool.submit(one)
            return first.result(), second.result()
    finally:
        sys.setswitchinterval(interval)


def _prepared(
    scene: Scene, model: Model, snapshots: dict[str, FloatArray], seed: int
) -> StepSolver:
    solver: StepSolver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, Offline.of(model, snapshots),
        np.random.default_rng(seed)))
    return solver


@np.errstate(all="ignore")  # each thread has its own; overflow is a status of the step
def _march(scene: Scene, model: Model, solver: StepSolver, steps: int, how: str = "") -> FloatArray:
    """(steps, n) states. how: from what memory the second half goes on: "stored" as plain data and
    read again, "copied" before a step is tried with the original, "" itself."""
    h, kept = scene.time.step, list[FloatArray]()
    step = FixedStep(scene.integrator, solver, h)
    state, memory = started(solver, scene.integrator, consistent_state(model))
    for count in (steps // 2, steps - steps // 2):
        for taken in iterate(step, state, memory, count):
            outcome, state, memory, _ = taken
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
    """A step solver whose every outcome is checked."""

    def start(self, state: State) -> tuple[State, StepMemory]:
        reduced, memory = self.base.start(state)
        law(isinstance(memory, StepMemory), "the memory has no copy()")
        return reduced, memory

    def solve(self, step: StepFormula, memory: StepMemory) -> tuple[StepOutcome, StepMemory]:
        before = step.r1.copy(), step.r2.copy()
        outcome, memory = self.base.solve(step, memory)
        law(all(np.array_equal(a, b) for a, b in zip(before, (step.r1, step.r2), strict=True)),
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
    """The memory as `--resume` gets it: written as plain data, read into one of the start."""
    try:
        stored = Saved.of(memory).dump()
        restored: StepMemory = Saved.load(stored).into(solver.start(consistent_state(model))[1])
        return restored
    except (TypeError, SavedError) as error:
        raise AssertionError(f"the memory cannot be stored and read again: {error}") from None


def _solver(solver: StepSolver, model: Model) -> None:
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
