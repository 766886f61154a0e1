"""The time loop: assemble, prepare, step, store. The only place where a status becomes an error."""

import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from sparsemor.core.assemble import assemble
from sparsemor.core.cache import Cache
from sparsemor.core.errors import InputError
from sparsemor.core.hooks import Manager, RunStart, new_manager
from sparsemor.core.initial import consistent_state
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline, offline_of, step_count
from sparsemor.core.protocols import State, StepOutcome, StepSolver
from sparsemor.core.recorder import Recorder, Tally
from sparsemor.core.results import RunResult
from sparsemor.core.scene import Scene
from sparsemor.core.status import SolveFailed, Status


def simulate(
    scene: Scene, *, out: str | Path | None = None, resume: bool = False,
    observers: Sequence[object] = (), cache: Cache | None = None,
) -> RunResult:
    """Run a scene and store its result under `out` (a temporary directory when not given).

    Raises InputError before anything is written, SolveFailed (with `.result`, readable up to
    there) when the run stops before its end. `resume` goes on from the last checkpoint.
    """
    begun = time.perf_counter()
    manager = new_manager(observers)
    steps = _checked_steps(scene)
    model = assemble(scene)
    offline = offline_of(scene, model, cache or Cache(), manager)
    solver: StepSolver = scene.reducer.prepare(
        model, scene.integrator, scene.time.step, offline, np.random.default_rng(scene.seed))
    state, memory = solver.start(consistent_state(model))
    state = scene.integrator.start(solver.layout, state)
    tally = Tally(offline=time.perf_counter() - begun)
    path = Path(out) if out is not None else Path(mkdtemp(prefix="sparsemor-"))
    recorder = Recorder.open(scene, model, solver, offline, path, resume, steps)
    if recorder.checkpoint is not None:
        state, memory, tally = recorder.restored(tally)
    for block, rows in solver.rows.items():
        manager.hook.on_resample(block=block, rows=rows)
    run = _Run(scene, model, solver, recorder, manager, steps, offline)
    return run.go(state, memory, tally)


def _checked_steps(scene: Scene) -> int:
    steps, h, end = step_count(scene), scene.time.step, scene.time.end
    if abs(steps * h - end) > 1e-6 * h:
        raise InputError(f"time.end = {end:g} s is not a whole number of steps of {h:g} s "
                         f"({end / h:.6g} steps)", "time.end")
    return steps


class _Run:
    """One pass through the loop, with what does not change in it."""

    def __init__(
        self, scene: Scene, model: Model, solver: StepSolver, recorder: Recorder,
        manager: Manager, steps: int, offline: Offline,
    ) -> None:
        self.scene, self.model, self.solver, self.recorder = scene, model, solver, recorder
        self.manager, self.steps, self.offline = manager, steps, offline

    def go(self, state: State, memory: Any, tally: "Tally") -> RunResult:
        title = RunStart(self.scene.title, self.recorder.reducer, state.t,
                         self.scene.time.end, self.steps - tally.done)
        self.manager.hook.on_start(run=title)
        if tally.done == 0:
            self.recorder.start(state, self.solver.supports(memory))
        begun, before = time.perf_counter(), tally.online
        try:
            failed = self._steps(state, memory, tally, begun - before)
        except KeyboardInterrupt:
            failed = (Status.INTERRUPTED, StepOutcome(state.x, Status.INTERRUPTED, 0), state.t)
        tally.online = before + time.perf_counter() - begun
        self.recorder.flush()
        status = Status.DONE if failed is None else failed[0]
        summary = self.recorder.summary(status, tally, memory)
        if failed is not None:
            error = SolveFailed(status, failed[2], failed[1].block, failed[1].detail)
            summary["message"] = str(error)
            self.manager.hook.on_failure(
                status=status, t=failed[2], block=failed[1].block, detail=failed[1].detail)
        self.recorder.finish(status, summary)
        self.manager.hook.on_finish(summary=summary)
        result = RunResult(self.recorder.store)
        if failed is not None:
            error.result = result
            raise error
        return result

    def _steps(
        self, state: State, memory: Any, tally: "Tally", begun: float
    ) -> tuple[Status, StepOutcome, float] | None:
        """None when all steps were taken; else why not, and when (s)."""
        integrator, solver, h = self.scene.integrator, self.solver, self.scene.time.step
        layout, watched = solver.layout, self.manager.has_observers
        changes = -1
        while tally.done < self.steps:
            start = time.perf_counter()
            formula = integrator.formula(layout, state, h)
            outcome, memory = solver.solve(formula, memory)
            if not outcome.status.ok:
                return outcome.status, outcome, formula.t
            state = integrator.advance(layout, state, formula, outcome.x, h)
            tally.add(time.perf_counter() - start, outcome.iterations)
            supports = solver.supports(memory)
            tally.count_atoms(supports)
            if self.recorder.take(tally.done, state, outcome, supports, tally.last):
                tally.online = time.perf_counter() - begun
                self.recorder.save(state, memory, tally)
            if watched:
                self.manager.hook.on_step(
                    step=tally.done, t=state.t, x=state.x, outcome=outcome)
                changes = self._tell_changes(changes, memory, state.t)
        return None

    def _tell_changes(self, before: int, memory: Any, t: float) -> int:
        count = self.solver.counters(memory).get("support_changes", 0)
        if count != before:
            for block, support in self.solver.supports(memory).items():
                self.manager.hook.on_support_change(t=t, block=block, support=support)
        return count
