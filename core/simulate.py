"""The time loop: assemble, prepare, step, store. The only place where a status becomes an error."""

import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import Any

import numpy as np

from sparsemor.core.cache import Cache
from sparsemor.core.errors import InputError
from sparsemor.core.estimate import room_for_result
from sparsemor.core.hooks import Manager, RunStart, new_manager
from sparsemor.core.initial import consistent_state
from sparsemor.core.interrupt import Interrupt
from sparsemor.core.memory import peak
from sparsemor.core.offline import step_count
from sparsemor.core.prepared import prepared
from sparsemor.core.protocols import Resampling, State, StepSolver
from sparsemor.core.recorder import Recorder, Tally, admit, told
from sparsemor.core.results import RunResult
from sparsemor.core.scene import Scene
from sparsemor.core.served import Held
from sparsemor.core.stability import check_run
from sparsemor.core.status import SolveFailed, Status
from sparsemor.core.step_control import ControlledSteps, controlled, step_of
from sparsemor.core.unmet import unmet


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
    if out is not None:
        admit(scene, Path(out), resume)
    elif resume:
        raise InputError("say which result to go on with: give its directory", "out")
    model, offline = prepared(scene, cache or Cache(), manager)
    if not resume:  # what is left to write is less than the whole
        room_for_result(scene, model, Path(gettempdir() if out is None else out))
    with np.errstate(all="ignore"):  # overflow ends in a status, not in a warning
        solver: StepSolver = scene.reducer.prepare(
            model, scene.integrator, scene.time.step, offline, np.random.default_rng(scene.seed))
        full = consistent_state(model)
        notes, stability = check_run(scene, model, solver, full)
        solver = controlled(scene, model, offline, solver)
        state, memory = solver.start(full)
        state = scene.integrator.start(solver.layout, state)
        tally = Tally(offline=time.perf_counter() - begun)
        path = Path(out) if out is not None else Path(mkdtemp(prefix="sparsemor-"))
        recorder = Recorder.open(
            scene, model, solver, offline, path, resume, step_count(scene))
        recorder.notes, recorder.stability = notes, stability
        recorder.memory = Held(offline.expected, peak())
        if recorder.checkpoint is not None:
            state, memory, tally = recorder.restored(tally)
        sampled = solver.rows_at(memory) if isinstance(solver, Resampling) else solver.rows
        for block, rows in sampled.items():
            manager.hook.on_resample(block=block, rows=rows)
        return _Run(scene, solver, recorder, manager, state, memory, tally).go()


class _Run:
    """One pass through the loop: what does not change in it, and how far it has come."""

    def __init__(
        self, scene: Scene, solver: StepSolver, recorder: Recorder, manager: Manager,
        state: State, memory: Any, tally: Tally,
    ) -> None:
        self.scene, self.solver, self.recorder, self.manager = scene, solver, recorder, manager
        self.state, self.memory, self.tally = state, memory, tally
        self.steps = step_count(scene)

    def go(self) -> RunResult:
        tally, recorder, hook = self.tally, self.recorder, self.manager.hook
        hook.on_start(run=RunStart(
            self.scene.title, recorder.reducer, self.state.t, self.scene.time.end,
            self.steps - tally.done))
        if recorder.checkpoint is None:  # from here on a killed run can be resumed
            recorder.start(self.state, self.solver.supports(self.memory), self.memory)
            recorder.save(self.state, self.memory, tally)
        self._begun = time.perf_counter() - tally.online
        with Interrupt() as interrupt:
            failure = self._steps(interrupt)
        tally.online = time.perf_counter() - self._begun
        if failure is None:
            recorder.flush()
        elif failure.status is Status.INTERRUPTED:
            recorder.save(self.state, self.memory, tally)
        else:
            recorder.keep_last(
                self.state, tally, self.solver.supports(self.memory), self.memory)
            hook.on_failure(status=failure.status, t=failure.time, block=failure.block,
                            detail=failure.detail)
        return self._finish(failure)

    def _finish(self, failure: SolveFailed | None) -> RunResult:
        status = Status.DONE if failure is None else failure.status
        summary = self.recorder.summary(status, self.tally, self.state, self.memory)
        if isinstance(self.solver, ControlledSteps):
            summary["control"] = self.solver.summary(self.memory)
        if failure is not None:
            summary["message"] = str(failure)
        else:
            found = told(unmet(self.recorder.model, RunResult(self.recorder.store)))
            summary |= {key: [*summary[key], *texts] for key, texts in found.items()}
        self.recorder.finish(status, summary)
        self.manager.hook.on_finish(summary=summary)
        result = RunResult(self.recorder.store)
        if failure is not None:
            failure.result = result
            raise failure
        return result

    @np.errstate(all="ignore")  # overflow is a status of the step, not a warning
    def _steps(self, interrupt: Interrupt) -> SolveFailed | None:
        """None when all steps were taken; else why not, and when."""
        solver, h = self.solver, self.scene.time.step
        step = step_of(solver, self.scene.integrator, h)
        watched, tally = self.manager.has_observers, self.tally
        changes, resamplings = -1, self._resamplings()
        while tally.done < self.steps:
            if interrupt.wanted:
                return SolveFailed(Status.INTERRUPTED, self.state.t)
            start = time.perf_counter()
            outcome, self.state, self.memory = step(self.state, self.memory)
            if not outcome.status.ok:
                return SolveFailed(
                    outcome.status, self.state.t + h, outcome.block, outcome.detail)
            tally.add(time.perf_counter() - start, outcome.iterations)
            supports = solver.supports(self.memory)
            tally.count_atoms(supports)
            if self.recorder.take(self.state, tally, supports, self.memory):
                tally.online = time.perf_counter() - self._begun
                self.recorder.save(self.state, self.memory, tally)
            if watched:
                resamplings = self._tell_rows(resamplings)
                self.manager.hook.on_step(
                    step=tally.done, t=self.state.t, x=self.state.x, outcome=outcome)
                changes = self._tell_changes(changes, self.memory, self.state.t)
        return None

    def _resamplings(self) -> int:
        return self.solver.counters(self.memory).get("resamplings", 0)

    def _tell_rows(self, before: int) -> int:
        count = self._resamplings()
        if count != before and isinstance(self.solver, Resampling):
            for block, rows in self.solver.rows_at(self.memory).items():
                self.manager.hook.on_resample(block=block, rows=rows)
        return count

    def _tell_changes(self, before: int, memory: Any, t: float) -> int:
        count = self.solver.counters(memory).get("support_changes", 0)
        if count != before:
            for block, support in self.solver.supports(memory).items():
                self.manager.hook.on_support_change(t=t, block=block, support=support)
        return count
