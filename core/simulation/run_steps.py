"""Time loop of a run: its steps and what is recorded of them."""

import errno
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import numpy as np

from sparsemor.core.errors import Damaged, InputError, PluginError
from sparsemor.core.protocols import ManySteps, RedrawsRows, State, StepMemory
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.registry.hooks import Manager, RunStart
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.blow_up import Extents, Growth, Large, diverged, too_long
from sparsemor.core.simulation.checks import Checks, Findings
from sparsemor.core.simulation.error_control.actions import (
    Accepted,
    ErrorMonitor,
    Exceeded,
    at_full_order,
)
from sparsemor.core.simulation.error_control.continuation import (
    Continuation,
    fall_back,
    with_more_atoms,
)
from sparsemor.core.simulation.error_control.record import ErrorRecord
from sparsemor.core.simulation.interrupt import Interrupt
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.recorder import Recorder, in_summary
from sparsemor.core.simulation.step_control import ControlledSteps, ControlMemory, step_of
from sparsemor.core.simulation.step_statistics import StepStatistics
from sparsemor.core.simulation.time_stepping import iterate, many_steps, started
from sparsemor.core.simulation.training import SnapshotCollector
from sparsemor.core.status import SolveFailed, Status


class RunSteps:
    """Time loop of one run: constant data, current state, step memory and statistics."""

    def __init__(
        self, run: PreparedRun, recorder: Recorder, manager: Manager,
        state: State, memory: StepMemory, stats: StepStatistics,
        collector: SnapshotCollector | None = None, many: ManySteps | None = None,
        monitor: ErrorMonitor | None = None,
    ) -> None:
        self.run, self.scene, self.solver = run, run.scene, run.solver
        self.recorder, self.manager = recorder, manager
        self.state, self.memory, self.stats, self.many = state, memory, stats, many
        self.steps = step_count(run.scene)
        self.collector, self.monitor, self.due = collector, monitor, False
        self.seen_changes, self.seen_draws = -1, self._resamplings()
        self.growth: Growth | None = Growth(Extents(()))
        self.checks = Checks.of(run.scene)
        # what checks see of steps is not in checkpoints
        self.on_step = self.checks.on_start(
            run, state, stats.done == 0 and monitor is None and not recorder.fall_back)

    @classmethod
    @np.errstate(all="ignore")  # overflow ends in a status, not in a warning
    def begin(
        cls, run: PreparedRun, recorder: Recorder, manager: Manager, stats: StepStatistics,
        collector: SnapshotCollector | None = None, begin: tuple[State, StepMemory] | None = None,
    ) -> "RunSteps":
        """All steps of a prepared run, or those after its checkpoint. begin: the state and memory
        with which they begin (`started`), if they are known."""
        scene, solver = run.scene, run.solver
        state, memory = begin or started(solver, scene.integrator, run.start)
        complete(memory, StepMemory, scene.reducer, "start", "reducer")
        many = many_steps(solver, scene.integrator, scene.time.step, run.steps)
        if run.estimator is not None:
            recorder.errors = ErrorRecord(run.estimator, run.start, state, run.changes)
        monitor = _monitor(run, state, recorder.errors)
        if recorder.errors is not None and recorder.fall_back:  # a run that is resumed after it
            recorder.errors.exact, monitor = True, None
            run = at_full_order(run, Exceeded.of(recorder.fall_back))
            recorder.set_run(run)
            solver, many = run.solver, None
            state, memory = started(solver, scene.integrator, run.start)
        if recorder.checkpoint is not None:
            state, memory, stats = recorder.restored(state, memory, stats)
        sampled = solver.rows_at(memory) if isinstance(solver, RedrawsRows) else solver.rows
        for block, rows in sampled.items():
            manager.hook.on_resample(block=block, rows=rows)
        return cls(run, recorder, manager, state, memory, stats, collector, many, monitor)

    def take(self) -> SolveFailed | None:
        """Takes and records the steps; returns None, or the error of a failed step or an
        interruption."""
        recorder, hook = self.recorder, self.manager.hook
        try:
            with Interrupt() as interrupt:  # while the first checkpoint is written, too
                hook.on_start(run=RunStart(
                    self.scene.title, recorder.reducer, self.state.t, self.scene.time.end,
                    self.steps - self.stats.done))
                if recorder.checkpoint is None:  # from here on a killed run can be resumed
                    recorder.start(self.state, self.solver.supports(self.memory), self.memory)
                    recorder.save(self.state, self.memory, self.stats)
                self._begun = time.perf_counter() - self.stats.online
                if self.collector is not None:
                    self.collector.take(self.stats.done, self.state)
                failure = self._steps(interrupt)
        finally:
            if self.collector is not None:
                self.collector.close()
        self.stats.online = time.perf_counter() - self._begun
        if failure is None or failure.status in (Status.INTERRUPTED, Status.INACCURATE):
            recorder.save(self.state, self.memory, self.stats)
        else:
            recorder.keep_last(
                self.state, self.stats, self.solver.supports(self.memory), self.memory)
        if failure is not None and failure.status is not Status.INTERRUPTED:
            hook.on_failure(status=failure.status, t=failure.time, block=failure.block,
                            detail=failure.detail)
        self.stats.online = time.perf_counter() - self._begun  # with what was written last
        return failure

    @np.errstate(all="ignore")
    def finish(self, failure: SolveFailed | None) -> RunResult:
        """The result, with its summary and what checks find in it. Raises the failure."""
        status = Status.DONE if failure is None else failure.status
        summary = self.recorder.summary(status, self.stats, self.state, self.memory)
        if isinstance(self.solver, ControlledSteps) and isinstance(self.memory, ControlMemory):
            summary["control"] = self.solver.summary(self.memory)
        if failure is not None:
            summary["message"] = str(failure)
        else:
            found = self._found_after()
            failure, entries = found.failure, in_summary(found.notes)
            summary = {**found.summary, **summary} | {
                key: [*summary[key], *texts] for key, texts in entries.items()}
            if failure is not None:
                status = failure.status
                summary |= {"status": status.value, "message": str(failure)}
        result = self.recorder.finish(status, summary)
        self.manager.hook.on_finish(summary=summary)
        if failure is not None:
            failure.result = result
            raise failure
        return result

    def _found_after(self) -> Findings:
        """What checks find after the last step. Raises OSError if a part of the stored results has
        been lost since."""
        result = self.recorder.writer.result()
        try:
            return self.checks.after_run(self.run, result)
        except Damaged as error:
            raise OSError(errno.EIO, str(error)) from None
        except PluginError as error:
            if isinstance(error.__cause__, OSError):
                raise error.__cause__ from None
            return Findings(failure=self._of_plugin(error))

    def _of_plugin(self, error: PluginError) -> SolveFailed:
        """Failure of a run by a fault of a plugin: hours of computed steps are not thrown away."""
        if error.own and self.run.model is None:  # the fault of the file of a kept model
            raise error
        return SolveFailed(Status.PLUGIN_FAILED, self.state.t, detail=str(error))

    @np.errstate(all="ignore")  # overflow is a status of the step, not a warning
    def _steps(self, interrupt: Interrupt) -> SolveFailed | None:
        """Takes all remaining steps; returns None, or the error of a failed step or an
        interruption. Where a run acts on its estimated error, what it does not accept is taken
        back: nothing is written between two estimates."""
        accepted = self._accepted()
        while (left := self.steps - self.stats.done) > 0:
            if self.monitor is None:
                return self._portion(left, lambda: interrupt.wanted)
            if interrupt.wanted:
                return SolveFailed(Status.INTERRUPTED, self.state.t)
            every, action = self.monitor.every, self.monitor.limit.action
            failure = self._portion(min(left, every - self.stats.done % every), lambda: False)
            assert self.recorder.errors is not None
            why = self.monitor.exceeded(self.state, self.recorder.errors.present()) if (
                failure is None) else Exceeded.failed(failure)
            if why is None:
                if self.due:
                    self._save()
                accepted = self._accepted()
            elif action == "stop":
                return failure or SolveFailed(
                    Status.INACCURATE, self.state.t, why.block, why.reason)
            else:
                self._roll_back(accepted)
                context = self.run, self.recorder, self.stats
                found = None if action == "fall_back" else with_more_atoms(
                    *context, self.manager, self.state, self.monitor, why, self.steps)
                self._switch(found or fall_back(
                    *context, self.state, replace(why, t=self.state.t)))
                accepted = self._accepted()
        return None

    def _accepted(self) -> Accepted:
        return Accepted(self.state, deepcopy(self.stats), self.recorder.mark())

    def _roll_back(self, accepted: Accepted) -> None:
        """Drops the steps after an accepted state."""
        self.recorder.roll_back(accepted.mark)
        self.state, self.stats = accepted.state, accepted.stats
        self.on_step = self.checks.on_start(self.run, self.state, False)

    def _switch(self, found: Continuation) -> None:
        """Takes the remaining steps with another step solver."""
        self.run, self.solver = found.run, found.run.solver
        self.state, self.memory = found.state, found.memory
        self.many, self.monitor = found.many, found.monitor
        self.on_step = self.checks.on_start(self.run, self.state, False)
        self._save()

    def _save(self) -> None:
        self.stats.online, self.due = time.perf_counter() - self._begun, False
        self.recorder.save(self.state, self.memory, self.stats)

    def _portion(self, count: int, stop: Callable[[], bool]) -> SolveFailed | None:
        """Takes `count` steps; returns None, or the error of a failed step, of a plugin, or of an
        interruption."""
        try:
            with naming_plugins():
                return self._taken(count, stop)
        except PluginError as error:
            return self._of_plugin(error)

    def _taken(self, count: int, stop: Callable[[], bool]) -> SolveFailed | None:
        solver, h = self.solver, self.scene.time.step
        step = step_of(solver, self.scene.integrator, h)
        watched, stats, end = self.manager.has_observers, self.stats, self.stats.done + count
        extents = self.run.extents if self.run.extents.blocks else Extents.of(
            self.run.model, solver.layout, solver.dictionaries)
        if self.growth is not None and not self.growth.last:
            self.growth = Growth(extents)
        for taken in iterate(step, self.state, self.memory, count, stop, self.many):
            outcome, before = taken.outcome, self.state
            _, self.state, self.memory, seconds, whole = taken
            if not outcome.status.ok:
                return SolveFailed(
                    outcome.status, self.state.t + h, outcome.block, outcome.detail,
                    sampled=bool(solver.rows))
            stats.add(seconds, outcome)
            supports = solver.supports(self.memory)
            if large := extents.exceeded(self.state.x):
                return self._diverged(large)
            for look in self.on_step:
                if (found := look(stats.done, before, self.state, supports)) is not None:
                    return found
            if self.growth is not None and (large := self.growth.sudden(self.state.x)):
                self.growth = None  # asked once
                if (found := self._too_long(large)) is not None:
                    return found
            if self.run.header.fall_back:
                stats.full_steps, stats.full_seconds = (
                    stats.full_steps + 1, stats.full_seconds + seconds)
            if self.collector is not None:
                self.collector.take(stats.done, self.state)
            if supports:
                stats.count_atoms(supports)
            self.due = self.recorder.take(self.state, stats, supports, self.memory) or self.due
            # in a block of steps the memory is that of its last one
            if self.due and whole and self.monitor is None:
                self._save()
            if watched:
                self.seen_draws = self._report_rows(self.seen_draws)
                self.manager.hook.on_step(
                    step=stats.done, t=self.state.t, x=self.state.x, outcome=outcome)
                self.seen_changes = self._report_changes(
                    self.seen_changes, self.memory, self.state.t)
        return SolveFailed(Status.INTERRUPTED, self.state.t) if stats.done < end else None

    def _too_long(self, large: Large) -> SolveFailed | None:
        """Failure of a run with displacements that half the step does not have."""
        run = self.run
        if run.model is None or run.offline is None:
            return None
        return too_long(self.scene, run.model, run.offline, run.start, self.state.t, large)

    def _diverged(self, large: Large) -> SolveFailed:
        """Failure of a run with displacements beyond a body."""
        run = self.run
        if run.offline is None or run.model is None:
            return SolveFailed(Status.DIVERGED, self.state.t, large.block, large.detail)
        return diverged(self.scene, run.model, run.offline, run.start, self.state, large)

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


def _monitor(
    run: PreparedRun, start: State, errors: ErrorRecord | None
) -> ErrorMonitor | None:
    """Comparison of the estimated errors with their tolerance, where the run acts on it.

    Raises InputError where a run should act and has no estimate.
    """
    limit = run.scene.reducer.error_limit
    if limit.action == "warn":
        return None
    if errors is None or run.model is None:
        raise InputError(f"action: {limit.action} needs the estimate and the assembled model, "
                         "which this reduced model does not have: take action: warn, or run its "
                         "scene", "reducer.error_estimate")
    return ErrorMonitor(limit, run, start, errors.changes)
