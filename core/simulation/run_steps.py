"""Time loop of a run: its steps, what is recorded of them, and what follows from a large estimated
error."""

import errno
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import numpy as np

from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.notes import Note
from sparsemor.core.protocols import (
    ManySteps,
    RedrawsRows,
    State,
    StepMemory,
)
from sparsemor.core.registry.hooks import Manager, RunStart
from sparsemor.core.results.run_result import RunResult
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
    expanded,
)
from sparsemor.core.simulation.error_control.enrichment import (
    LEFT_OUT,
    MOST,
    coefficient_maps,
    enriched,
    in_atoms,
    with_new_atoms,
)
from sparsemor.core.simulation.error_control.enrichment import STEPS as ADDED_STEPS
from sparsemor.core.simulation.error_control.notes import error_limit, large_estimates
from sparsemor.core.simulation.error_control.record import ErrorRecord
from sparsemor.core.simulation.interrupt import Interrupt
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.prepare import PreparedRun
from sparsemor.core.simulation.recorder import Recorder, in_summary
from sparsemor.core.simulation.step_control import (
    ControlledSteps,
    ControlMemory,
    step_of,
)
from sparsemor.core.simulation.step_statistics import Tally
from sparsemor.core.simulation.time_stepping import iterate, many_steps, started
from sparsemor.core.simulation.training import SnapshotKeeper
from sparsemor.core.status import SolveFailed, Status


class RunSteps:
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
        if failure is None or failure.status in (Status.INTERRUPTED, Status.INACCURATE):
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
                self._take_back(accepted)
                if action == "fall_back" or not self._enrich(why):
                    self._fall_back(replace(why, t=self.state.t))
                accepted = self._accepted()
        return None

    def _accepted(self) -> Accepted:
        return Accepted(self.state, deepcopy(self.tally), self.recorder.mark())

    def _take_back(self, accepted: Accepted) -> None:
        """Drops the steps after an accepted state."""
        self.recorder.back_to(accepted.mark)
        self.state = accepted.state
        for name, value in vars(deepcopy(accepted.tally)).items():
            setattr(self.tally, name, value)

    def _full_state(self) -> State:
        assert self.run.model is not None
        return expanded(
            self.state, self.solver.layout, self.solver.dictionaries, self.run.model.layout)

    def _fall_back(self, why: Exceeded) -> None:
        """Goes on at full order from the present state."""
        begun, start = time.perf_counter(), self._full_state()
        assert self.recorder.errors is not None
        self.run = at_full_order(self.run, why)
        self.solver, self.watch, self.many = self.run.solver, None, None
        self.recorder.go_on(self.run, {})
        self.recorder.errors.exact = True
        self.state, self.memory = started(self.solver, self.scene.integrator, start)
        self.tally.full_seconds += time.perf_counter() - begun
        self._save()

    def _enrich(self, why: Exceeded) -> bool:
        """Takes some steps at full order from the present state, and goes on with atoms that
        represent them; False, with nothing changed, where that is not possible."""
        begun, run, tally, recorder = time.perf_counter(), self.run, self.tally, self.recorder
        model, errors, watch = run.model, recorder.errors, self.watch
        assert model is not None and errors is not None and watch is not None
        count = -(-ADDED_STEPS // watch.every) * watch.every
        count -= tally.done % watch.every
        if len(run.header.enriched) == MOST or count >= self.steps - tally.done:
            return False
        full = at_full_order(run, why).solver
        steps = list(iterate(
            step_of(full, self.scene.integrator, self.scene.time.step),
            *started(full, self.scene.integrator, self._full_state()), count))
        if not steps[-1].outcome.status.ok:
            return False
        states, old = [s.state for s in steps], run.solver.dictionaries
        permitted = {n: LEFT_OUT * watch.limit.tolerance * c for n, c in errors.changes.items()
                     if n in old}
        try:
            new = enriched(run, with_new_atoms(old, states, model.layout, permitted), self.state.t)
        except (InputError, SolveFailed):
            return False
        assert new.estimator is not None
        solver, layout = new.solver, new.solver.layout
        state, memory = started(solver, self.scene.integrator, states[-1])
        recorder.go_on(new, coefficient_maps(old, solver.dictionaries))
        errors.exact, supports = True, solver.supports(memory)
        for taken in steps:
            tally.add(taken.seconds, taken.outcome)
            tally.full_steps += 1
            reduced = in_atoms(taken.state, layout, model.layout, solver.dictionaries)
            recorder.take(reduced, tally, supports, memory)
            if self.manager.has_observers:
                self.manager.hook.on_step(
                    step=tally.done, t=reduced.t, x=reduced.x, outcome=taken.outcome)
        recorder.flush()
        recorder.errors = errors = ErrorRecord(
            new.estimator, errors.estimator.corrected(states[-1], errors.memory), state,
            errors.changes)
        self.run, self.solver, self.state, self.memory = new, solver, state, memory
        self.many = many_steps(solver, self.scene.integrator, self.scene.time.step, self.steps)
        self.watch = ErrorWatch(
            watch.limit, new, solver.start(run.start)[0], errors.changes)
        tally.full_seconds += time.perf_counter() - begun
        self._save()
        return True

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
