"""Time loop of a run: its steps and what is recorded of them."""

import errno
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import chain
from types import FrameType, TracebackType
from typing import Any

import numpy as np

from sparsemor.core.errors import Damaged, PluginError
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.step_solver import ManySteps, StepMemory
from sparsemor.core.protocols.time_function import holding
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.registry.hooks import Manager, RunStart
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.blow_up import Extents, Large, Limits, diverged, too_long
from sparsemor.core.simulation.checks import Checks, Findings
from sparsemor.core.simulation.controllers import Controllers
from sparsemor.core.simulation.error_record import ErrorRecord
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.recorder import Recorder, RecordMark, StepStatistics, in_summary
from sparsemor.core.simulation.sensors_and_outputs import outputs_of
from sparsemor.core.simulation.step_control import ControlledSteps, ControlMemory, step_of
from sparsemor.core.simulation.time_stepping import TimeStep, in_blocks, many_steps, started
from sparsemor.core.simulation.training import SnapshotCollector
from sparsemor.core.status import SolveFailed, Status


@dataclass(frozen=True, slots=True, eq=False)
class Accepted:
    """Last state that a control has accepted, with the statistics and the record up to there."""

    state: State
    stats: StepStatistics
    mark: RecordMark


class StepControl(ABC):
    """Control of a run that may take steps back, as by their estimated error. Between two states
    that it accepts nothing is written."""

    @abstractmethod
    def begin(self, steps: "RunSteps") -> None:
        """Called before the first step, and before a checkpoint is read."""

    @abstractmethod
    def take(self, steps: "RunSteps", stop_requested: Callable[[], bool]) -> SolveFailed | None:
        """Takes all remaining steps by `steps.portion`; returns None, or the error of a failed step
        or an interruption. stop_requested: True when the run is to be interrupted."""


class Interrupt:
    """Context in which a first Ctrl-C only sets `stop_requested`, so that a run stops between two
    steps, in a state from which it can be resumed; a second one stops at once, as usual.

    Without effect outside the main thread, where Python sets no signal handlers, or where Ctrl-C is
    ignored.
    """

    def __init__(self) -> None:
        self.stop_requested = False
        self._before: Any = None

    def __enter__(self) -> "Interrupt":
        in_main = threading.current_thread() is threading.main_thread()
        if in_main and callable(signal.getsignal(signal.SIGINT)):
            self._before = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.stop_requested = True
        self._restore()

    def _restore(self) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
            self._before = None


class RunSteps:
    """Time loop of one run: constant data, current state, step memory and statistics. Takes all
    steps of a prepared run, or those after its checkpoint.

    begin: the state and memory with which they begin (`started`), if they are known. earlier:
    number of steps that this process has taken with the same model, for which machine code pays,
    too. found: what checks found in an earlier run of the same steps, which they do not look at
    again; then that of this run, None until it has ended. undecided: True while a control decides
    on what is written.
    """

    @np.errstate(all="ignore")  # overflow ends in a status, not in a warning
    def __init__(
        self, run: PreparedRun, recorder: Recorder, manager: Manager, stats: StepStatistics,
        collector: SnapshotCollector | None = None, begin: tuple[State, StepMemory] | None = None,
        earlier: int = 0, found: Findings | None = None,
    ) -> None:
        """stats: of the steps taken so far; collector: of training snapshots, if the run makes
        some; begin, earlier, found: as in the class. Of a resumed run, state, memory and statistics
        are those of its checkpoint.

        due: True when it is time for a checkpoint; seen_changes, seen_draws: numbers of changes of
        the active atoms, and of samplings, that observers were told of; limits: watches for large
        and for suddenly growing displacements; trial: True until the one trial run that looks for
        the cause of sudden growth. undecided: True while a control decides on what is written.
        """
        scene = run.scene
        self.run, self.scene, self.solver = run, scene, run.solver
        self.recorder, self.manager, self.stats, self.steps = recorder, manager, stats, run.steps
        self.collector, self.due, self.undecided = collector, False, False
        self.state, self.memory = begin or started(self.solver, scene.integrator, run.start)
        complete(self.memory, StepMemory, scene.reducer, "start", "reducer")
        # the solver's way to take several steps in one call, such as compiled ones, or None
        self.many = many_steps(
            self.solver, scene.integrator, scene.time.step, earlier + run.steps)
        if run.estimator is not None:
            recorder.errors = ErrorRecord(
                run.estimator, run.full_start or run.start, self.state, run.changes)
        self.stats.controllers = self._controllers().begin()
        self.found, self.checks = found, Checks.for_scene(scene) if found is None else Checks(())
        self.control = self.checks.control(run)
        if self.control is not None:
            assert isinstance(self.control, StepControl)
            self.control.begin(self)
        if recorder.checkpoint is not None:
            self.state, self.memory, self.stats = recorder.restored(
                self.state, self.memory, self.stats)
        sampled = self.solver.rows_at(self.memory)
        for block, rows in sampled.items():
            manager.hook.on_resample(block=block, rows=rows)
        self.seen_changes, self.seen_draws = -1, self._resamplings()
        self.limits, self.trial = Limits(Extents(())), True  # blocks follow in `_taken`
        # what checks see of steps is not in checkpoints
        self.on_step = self.checks.on_start(
            self.run, self.state,
            self.stats.done == 0 and not self.undecided and not recorder.fall_back)

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
                # as if the steps of an earlier process had been taken in this one
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
            found = self.found = self.found or self._found_after()
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
        interruption."""
        if isinstance(self.control, StepControl):
            return self.control.take(self, lambda: interrupt.stop_requested)
        return self.portion(self.steps - self.stats.done, lambda: interrupt.stop_requested)

    def _controllers(self) -> Controllers:
        run = self.run
        return Controllers(self.scene, outputs_of(
            self.solver.layout, run.header.multipliers, run.probes, run.forces))

    def accepted(self) -> Accepted:
        """The present state, to come back to."""
        return Accepted(self.state, deepcopy(self.stats), self.recorder.mark())

    def roll_back(self, accepted: Accepted) -> None:
        """Drops the steps after an accepted state."""
        self.recorder.roll_back(accepted.mark)
        self.state, self.stats = accepted.state, accepted.stats
        self.on_step = self.checks.on_start(self.run, self.state, False)

    def set_run(
        self, run: PreparedRun, state: State, memory: StepMemory, many: ManySteps | None = None
    ) -> None:
        """Goes on with the step solver of another run from its present state. many: its blocks of
        steps."""
        self.run, self.solver, self.many = run, run.solver, many
        self.state, self.memory = state, memory

    def switch_run(
        self, run: PreparedRun, state: State, memory: StepMemory, many: ManySteps | None = None
    ) -> None:
        """Goes on with the step solver of another run in the middle of this one, and writes a
        checkpoint."""
        self.set_run(run, state, memory, many)
        self.on_step = self.checks.on_start(self.run, self.state, False)
        self.save()

    def save(self) -> None:
        """Commits what is recorded, with a checkpoint."""
        self.stats.online, self.due = time.perf_counter() - self._begun, False
        self.recorder.save(self.state, self.memory, self.stats)

    def portion(self, count: int, stop: Callable[[], bool]) -> SolveFailed | None:
        """Takes `count` steps; returns None, or the error of a failed step, of a plugin, or of an
        interruption."""
        try:
            controllers = self._controllers()
            with naming_plugins(), holding(controllers.held):
                return self._taken(count, stop, controllers)
        except PluginError as error:
            return self._of_plugin(error)

    def _taken(
        self, count: int, stop: Callable[[], bool], controllers: Controllers
    ) -> SolveFailed | None:
        """Takes up to `count` steps and records them; returns the failure that ends the run, None
        if all are taken. After each step: limits, checks that watch, snapshots, recorder,
        observers."""
        solver, h = self.solver, self.scene.time.step
        step = controllers.around(
            step_of(solver, self.scene.integrator, h), self.stats.controllers)
        watched, stats, end = self.manager.has_observers, self.stats, self.stats.done + count
        self.limits = self.limits.of(
            self.run.extents if self.run.extents.blocks else Extents.from_model(
                self.run.model, solver.layout, solver.dictionaries))
        many = None if controllers.found else self.many
        for taken in chain.from_iterable(map(self._judged, in_blocks(
                step, self.state, self.memory, count, stop, many))):
            (outcome, state, memory, seconds, whole), (too_large, sudden) = taken
            before, self.state, self.memory = self.state, state, memory
            if not outcome.status.ok:
                return SolveFailed(
                    outcome.status, self.state.t + h, outcome.block, outcome.detail,
                    sampled=bool(solver.rows))
            stats.add(seconds, outcome)
            supports = solver.supports(self.memory)
            if too_large:
                return self._diverged(too_large)
            for look in self.on_step:
                if (found := look(stats.done, before, self.state, supports)) is not None:
                    return found
            if sudden and self.trial:
                self.trial = False  # a trial run looks for the cause, once
                if (found := self._too_long(sudden)) is not None:
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
            if self.due and whole and not self.undecided:
                self.save()
            if watched:
                self.seen_draws = self._report_rows(self.seen_draws)
                self.manager.hook.on_step(
                    step=stats.done, t=self.state.t, x=self.state.x, outcome=outcome)
                self.seen_changes = self._report_changes(
                    self.seen_changes, self.memory, self.state.t)
        return SolveFailed(Status.INTERRUPTED, self.state.t) if stats.done < end else None

    def _judged(
        self, block: Sequence[TimeStep]
    ) -> Iterator[tuple[TimeStep, tuple[Large | None, Large | None]]]:
        """Steps with what is too large in each, and what has grown suddenly."""
        found = self.limits.found(
            block[0].state.x[None] if len(block) == 1 else np.stack([s.state.x for s in block]))
        return ((step, found.get(i, (None, None))) for i, step in enumerate(block))

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
        """Number of times so far that rows were sampled anew."""
        return self.solver.counters(self.memory).get("resamplings", 0)

    def _report_rows(self, before: int) -> int:
        """Tells observers the sampled rows if they changed since `before` samplings; returns the
        number of samplings."""
        count = self._resamplings()
        if count != before:
            for block, rows in self.solver.rows_at(self.memory).items():
                self.manager.hook.on_resample(block=block, rows=rows)
        return count

    def _report_changes(self, before: int, memory: StepMemory, t: float) -> int:
        """Tells observers the active atoms if they changed since `before` changes; returns the
        number of changes."""
        count = self.solver.counters(memory).get("support_changes", 0)
        if count != before:
            for block, support in self.solver.supports(memory).items():
                self.manager.hook.on_support_change(t=t, block=block, support=support)
        return count
