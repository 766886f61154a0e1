"""Simulation of a scene: assembles the model, prepares the reducer, runs the time loop, stores."""

import atexit
import errno
import shutil
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from tempfile import gettempdir, mkdtemp

import numpy as np

from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.model.body_cache import BodyCache
from sparsemor.core.model.model import Model
from sparsemor.core.notes import Note
from sparsemor.core.protocols import (
    ManySteps,
    RedrawsRows,
    State,
    StepMemory,
)
from sparsemor.core.registry.hooks import Manager, RunStart, new_manager
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.results.output_lock import owned
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.store import ResultWriter
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.admission import admit, kept
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.diagnostics.alternating_joint_forces import alternating_forces
from sparsemor.core.simulation.diagnostics.contact_warnings import contact_warnings
from sparsemor.core.simulation.diagnostics.plausibility import after_run
from sparsemor.core.simulation.diagnostics.trial_space import (
    beyond_training,
)
from sparsemor.core.simulation.diagnostics.undershoot import undershoot
from sparsemor.core.simulation.error_control.actions import (
    Accepted,
    ErrorWatch,
    Exceeded,
    at_full_order,
    error_limit,
    expanded,
)
from sparsemor.core.simulation.error_control.record import ErrorRecord, large_estimates
from sparsemor.core.simulation.interrupt import Interrupt
from sparsemor.core.simulation.memory.limits import peak
from sparsemor.core.simulation.memory.use import MemoryUse
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.prepare import PreparedRun, prepared_run
from sparsemor.core.simulation.recorder import Recorder, in_summary
from sparsemor.core.simulation.step_control import (
    ControlledSteps,
    ControlMemory,
    step_of,
)
from sparsemor.core.simulation.step_statistics import Tally
from sparsemor.core.simulation.time_stepping import iterate, many_steps, started
from sparsemor.core.simulation.training import SnapshotKeeper, training_steps
from sparsemor.core.status import SolveFailed, Status


@fixed_threads()
def simulate(
    scene: Scene, *, out: str | Path | None = None, resume: bool = False,
    observers: Sequence[object] = (), cache: Cache | None = None,
    body_cache: BodyCache | None = None, keep_training: bool = False,
) -> RunResult:
    """Run a scene and store its result under `out`; when not given, in a temporary directory that
    is removed when this process ends.

    Raises InputError before anything is written, also when another run is writing to `out`;
    SolveFailed (with the results up to there in `.result`) when the run stops before its end;
    OSError when the result cannot be written, or `out` was moved or removed. resume: continue from
    the last checkpoint. body_cache: bodies that other runs have built, for reuse. keep_training: a
    full-order run that begins with the training run of its scene leaves the snapshots in the cache,
    for reduced runs that follow.
    """
    with nullcontext() if out is None else owned(Path(out)):
        return _simulate(scene, out, resume, observers, cache, body_cache, keep_training)


def _simulate(
    scene: Scene, out: str | Path | None, resume: bool, observers: Sequence[object],
    cache: Cache | None, body_cache: BodyCache | None, keep_training: bool,
) -> RunResult:
    begun = time.perf_counter()
    manager = new_manager(observers)
    if out is not None:
        admit(scene, Path(out), resume)
    elif resume:
        raise InputError("resume needs the directory of the result to continue", "out")
    place = Path(gettempdir() if out is None else out)
    run, offline = prepared_run(  # what is left to write is less than the whole
        scene, cache or Cache(), manager, body_cache, None if resume else place)
    tally = Tally(offline=time.perf_counter() - begun)
    path = Path(out) if out is not None else _temporary()
    recorder = Recorder.open(run, path, resume, step_count(scene), offline.products)
    recorder.memory = MemoryUse(offline.expected, peak())
    assert run.model is not None and isinstance(recorder.writer, ResultWriter)
    # snapshots are those of a whole run: not of the rest of an interrupted one
    keeper = _keeper(scene, run.model, offline) if keep_training and not resume else None
    with kept(recorder.writer, new=recorder.checkpoint is None):
        result = stepped(run, recorder, manager, tally, keeper)
    if keeper is not None:
        offline.keep_training(keeper.finished(), keeper.share * tally.online)
    return result


def stepped(
    run: PreparedRun, recorder: Recorder, manager: Manager, tally: Tally,
    keeper: SnapshotKeeper | None = None, begin: tuple[State, StepMemory] | None = None,
) -> RunResult:
    """All steps of a prepared run, or those after its checkpoint. begin: the state and memory with
    which they begin (`started`), if they are known. Raises SolveFailed with the results up to there
    in `.result`."""
    scene, solver = run.scene, run.solver
    with np.errstate(all="ignore"):  # overflow ends in a status, not in a warning
        state, memory = begin or started(solver, scene.integrator, run.start)
        complete(memory, StepMemory, scene.reducer, "start", "reducer")
        many = many_steps(solver, scene.integrator, scene.time.step, step_count(scene))
        if run.estimator is not None:
            recorder.errors = ErrorRecord(
                run.estimator, run.start, state, {s.name: s.change for s in run.spaces})
        watch = _watch(run, state, recorder.errors)
        if recorder.errors is not None and recorder.fall_back:  # a run that is resumed after it
            recorder.errors.exact, watch = True, None
            run = at_full_order(run, Exceeded.of(recorder.fall_back))
            recorder.take_up(run)
            solver, many = run.solver, None
            state, memory = started(solver, scene.integrator, run.start)
        if recorder.checkpoint is not None:
            state, memory, tally = recorder.restored(state, memory, tally)
        sampled = solver.rows_at(memory) if isinstance(solver, RedrawsRows) else solver.rows
        for block, rows in sampled.items():
            manager.hook.on_resample(block=block, rows=rows)
        return _Run(run, recorder, manager, state, memory, tally, keeper, many, watch).go()


def _watch(
    run: PreparedRun, start: State, errors: ErrorRecord | None
) -> ErrorWatch | None:
    """Comparison of the estimated errors with their tolerance, where the run acts on it.

    Raises InputError where a run should act and has no estimate.
    """
    limit = error_limit(run.scene.reducer)
    if limit.action == "warn":
        return None
    if errors is None or run.model is None:
        raise InputError(f"action: {limit.action} needs the estimate and the assembled model, "
                         "which this reduced model does not have: take action: warn, or run its "
                         "scene", "reducer.error_estimate")
    return ErrorWatch(limit, run, start, errors.changes)


def _keeper(scene: Scene, model: Model, offline: Offline) -> SnapshotKeeper | None:
    """Recorder of training snapshots, if this run begins with a training run whose snapshots are
    not in the cache; else None."""
    if not model.reducible() or not (count := training_steps(scene)) or offline.has_training():
        return None
    return SnapshotKeeper(scene, count, model.layout, model.reducible(),
                          offline.products.scratch, step_count(scene))


def _temporary() -> Path:
    """New temporary directory, removed when the interpreter ends."""
    path = Path(mkdtemp(prefix="sparsemor-"))
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path


class _Run:
    """Time loop of one run: constant data, current state, step memory and statistics."""

    def __init__(
        self, run: PreparedRun, recorder: Recorder, manager: Manager,
        state: State, memory: StepMemory, tally: Tally, keeper: SnapshotKeeper | None = None,
        many: ManySteps | None = None, watch: ErrorWatch | None = None,
    ) -> None:
        self.run, self.scene, self.solver = run, run.scene, run.solver
        self.recorder, self.manager = recorder, manager
        self.state, self.memory, self.tally, self.many = state, memory, tally, many
        self.steps = step_count(run.scene)
        self.keeper, self.watch, self.due = keeper, watch, False
        self.seen_changes, self.seen_draws = -1, self._resamplings()

    def go(self) -> RunResult:
        tally, recorder, hook = self.tally, self.recorder, self.manager.hook
        try:
            with Interrupt() as interrupt:  # while the first checkpoint is written, too
                hook.on_start(run=RunStart(
                    self.scene.title, recorder.reducer, self.state.t, self.scene.time.end,
                    self.steps - tally.done))
                if recorder.checkpoint is None:  # from here on a killed run can be resumed
                    recorder.start(self.state, self.solver.supports(self.memory), self.memory)
                    recorder.save(self.state, self.memory, tally)
                self._begun = time.perf_counter() - tally.online
                if self.keeper is not None:
                    self.keeper.take(tally.done, self.state)
                failure = self._steps(interrupt)
        finally:
            if self.keeper is not None:
                self.keeper.close()
        tally.online = time.perf_counter() - self._begun
        if failure is None:
            recorder.flush()
        elif failure.status in (Status.INTERRUPTED, Status.INACCURATE):
            recorder.save(self.state, self.memory, tally)
        else:
            recorder.keep_last(
                self.state, tally, self.solver.supports(self.memory), self.memory)
        if failure is not None and failure.status is not Status.INTERRUPTED:
            hook.on_failure(status=failure.status, t=failure.time, block=failure.block,
                            detail=failure.detail)
        tally.online = time.perf_counter() - self._begun  # with what was written last
        return self._finish(failure)

    def _finish(self, failure: SolveFailed | None) -> RunResult:
        status = Status.DONE if failure is None else failure.status
        summary = self.recorder.summary(status, self.tally, self.state, self.memory)
        if isinstance(self.solver, ControlledSteps) and isinstance(self.memory, ControlMemory):
            summary["control"] = self.solver.summary(self.memory)
        if failure is not None:
            summary["message"] = str(failure)
        else:
            found = in_summary(self._found_after())
            summary |= {key: [*summary[key], *texts] for key, texts in found.items()}
        self.recorder.finish(status, summary)
        self.manager.hook.on_finish(summary=summary)
        result = self.recorder.writer.result()
        if failure is not None:
            failure.result = result
            raise failure
        return result

    def _found_after(self) -> tuple[Note, ...]:
        """Notes on the stored results. Raises OSError if a part of them has been lost since."""
        run, result = self.run, self.recorder.writer.result()
        model, notes = run.model, list(run.contacts or ())
        try:
            if model is not None and run.contacts is None:
                notes += contact_warnings(model, result)
            notes += alternating_forces(result)
            if model is not None:
                notes += undershoot(model, result) if run.own_loads else ()
                notes += after_run(model, result)
            return (*notes, *large_estimates(result, error_limit(self.scene.reducer).tolerance),
                    *beyond_training(run.spaces, result, run.trained_to))
        except Damaged as error:
            raise OSError(errno.EIO, str(error)) from None

    @np.errstate(all="ignore")  # overflow is a status of the step, not a warning
    def _steps(self, interrupt: Interrupt) -> SolveFailed | None:
        """Takes all remaining steps; returns None, or the error of a failed step or an
        interruption. Where a run acts on its estimated error, what it does not accept is taken
        back: nothing is written between two estimates."""
        accepted = self._accepted()
        while (left := self.steps - self.tally.done) > 0:
            if self.watch is None:
                return self._portion(left, lambda: interrupt.wanted)
            if interrupt.wanted:
                return SolveFailed(Status.INTERRUPTED, self.state.t)
            every, action = self.watch.every, self.watch.limit.action
            failure = self._portion(min(left, every - self.tally.done % every), lambda: False)
            assert self.recorder.errors is not None
            why = self.watch.exceeded(self.state, self.recorder.errors.present()) if (
                failure is None) else Exceeded.failed(failure)
            if why is None:
                if self.due:
                    self._save()
                accepted = self._accepted()
            elif action == "stop":
                return failure or SolveFailed(
                    Status.INACCURATE, self.state.t, why.block, why.reason)
            else:
                self._fall_back(accepted, why)
        return None

    def _accepted(self) -> Accepted:
        return Accepted(self.state, deepcopy(self.tally), self.recorder.mark())

    def _fall_back(self, accepted: Accepted, why: Exceeded) -> None:
        """Goes on at full order from an accepted state."""
        begun, old, model = time.perf_counter(), self.solver, self.run.model
        assert model is not None and self.recorder.errors is not None
        self.recorder.back_to(accepted.mark)
        for name, value in vars(accepted.tally).items():
            setattr(self.tally, name, value)
        why = replace(why, t=accepted.state.t)
        self.run = at_full_order(self.run, why)
        self.solver, self.watch, self.many = self.run.solver, None, None
        self.recorder.go_on(self.run)
        self.recorder.errors.exact = True
        self.state, self.memory = started(self.solver, self.scene.integrator, expanded(
            accepted.state, old.layout, old.dictionaries, model.layout))
        self.tally.full_seconds += time.perf_counter() - begun
        self._save()

    def _save(self) -> None:
        self.tally.online, self.due = time.perf_counter() - self._begun, False
        self.recorder.save(self.state, self.memory, self.tally)

    def _portion(self, count: int, stop: Callable[[], bool]) -> SolveFailed | None:
        """Takes `count` steps; returns None, or the error of a failed step or an interruption."""
        solver, h = self.solver, self.scene.time.step
        step = step_of(solver, self.scene.integrator, h)
        watched, tally, end = self.manager.has_observers, self.tally, self.tally.done + count
        for taken in iterate(step, self.state, self.memory, count, stop, self.many):
            outcome, self.state, self.memory, seconds, whole = taken
            if not outcome.status.ok:
                return SolveFailed(
                    outcome.status, self.state.t + h, outcome.block, outcome.detail,
                    sampled=bool(solver.rows))
            tally.add(seconds, outcome)
            if self.run.header.fall_back:
                tally.full_steps, tally.full_seconds = (
                    tally.full_steps + 1, tally.full_seconds + seconds)
            if self.keeper is not None:
                self.keeper.take(tally.done, self.state)
            supports = solver.supports(self.memory)
            if supports:
                tally.count_atoms(supports)
            self.due = self.recorder.take(self.state, tally, supports, self.memory) or self.due
            # in a block of steps the memory is that of its last one
            if self.due and whole and self.watch is None:
                self._save()
            if watched:
                self.seen_draws = self._report_rows(self.seen_draws)
                self.manager.hook.on_step(
                    step=tally.done, t=self.state.t, x=self.state.x, outcome=outcome)
                self.seen_changes = self._report_changes(
                    self.seen_changes, self.memory, self.state.t)
        return SolveFailed(Status.INTERRUPTED, self.state.t) if tally.done < end else None

    def _resamplings(self) -> int:
        return self.solver.counters(self.memory).get("resamplings", 0)

    def _report_rows(self, before: int) -> int:
        count = self._resamplings()
        if count != before and isinstance(self.solver, RedrawsRows):
            for block, rows in self.solver.rows_at(self.memory).items():
                self.manager.hook.on_resample(block=block, rows=rows)
        return count

    def _report_changes(self, before: int, memory: StepMemory, t: float) -> int:
        count = self.solver.counters(memory).get("support_changes", 0)
        if count != before:
            for block, support in self.solver.supports(memory).items():
                self.manager.hook.on_support_change(t=t, block=block, support=support)
        return count
