"""Runs that act on their estimated error: they stop, or go on at full order, or with atoms that
full-order steps need in addition."""

import time
from collections.abc import Callable
from dataclasses import replace

from sparsemor.core import ErrorLimit, State
from sparsemor.core.errors import InputError
from sparsemor.core.simulation.checks import Check
from sparsemor.core.simulation.error_record import ErrorRecord
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.run_steps import RunSteps, StepControl
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.time_stepping import iterate, many_steps, started
from sparsemor.core.status import SolveFailed, Status
from sparsemor.plugins.checks import place
from sparsemor.plugins.error_estimate.enrichment import (
    LEFT_OUT,
    MOST,
    STEPS,
    coefficient_maps,
    complete,
    enriched,
    in_atoms,
    with_new_atoms,
)
from sparsemor.plugins.error_estimate.tolerance_monitor import (
    ErrorMonitor,
    Exceeded,
    at_full_order,
    expanded,
)


class ErrorAction(Check):
    """What follows from an estimated error above its tolerance: `stop`, `fall_back`, `enrich`."""

    order = place("error_action")

    def control(self, run: PreparedRun) -> object | None:
        """Control of the steps, for actions other than `warn`. Raises InputError in runs without
        an estimate or without their assembled model."""
        limit = run.scene.reducer.error_limit
        if limit.action == "warn":
            return None
        if run.estimator is None or run.model is None or not run.own_loads:
            raise InputError(
                f"action: {limit.action} needs the estimate and the assembled model, which this "
                "reduced model does not have: take action: warn, or run its scene",
                "reducer.error_estimate")
        return ErrorControl(limit)


class ErrorControl(StepControl):
    """Takes the steps from one estimate of the error to the next, and takes those back that end
    beyond the tolerance. monitor: the comparison with it, None at full order."""

    def __init__(self, limit: ErrorLimit) -> None:
        self.limit = limit
        self.monitor: ErrorMonitor | None = None

    def begin(self, steps: RunSteps) -> None:
        run, errors = steps.run, steps.recorder.errors
        assert errors is not None
        if steps.recorder.fall_back:  # a run that is resumed after it
            errors.exact = True
            full = at_full_order(run, Exceeded.read(steps.recorder.fall_back))
            steps.recorder.set_run(full)
            steps.set_run(full, *started(full.solver, run.scene.integrator, run.start))
        else:
            self.monitor_by(steps, ErrorMonitor(self.limit, run, steps.state, errors.changes))

    def monitor_by(self, steps: RunSteps, monitor: ErrorMonitor | None) -> None:
        """Compares the errors of the steps that follow, None: accepts them."""
        self.monitor, steps.undecided = monitor, monitor is not None

    def take(self, steps: RunSteps, stop_requested: Callable[[], bool]) -> SolveFailed | None:
        """Takes the steps between two estimates at a time; where an estimate exceeds the tolerance,
        it takes them back and acts: stop, go on at full order, or with more atoms."""
        accepted = steps.accepted()  # the present state, to which steps are taken back
        while (remaining := steps.steps - steps.stats.done) > 0:
            if self.monitor is None:  # at full order there are no estimates
                return steps.portion(remaining, stop_requested)
            if stop_requested():
                return SolveFailed(Status.INTERRUPTED, steps.state.t)
            every = self.monitor.every
            failure = steps.portion(min(remaining, every - steps.stats.done % every), lambda: False)
            errors = steps.recorder.errors
            assert errors is not None
            excess = self.monitor.exceeded(steps.state, errors.present()) if (
                failure is None) else Exceeded.failed(failure)
            if excess is None:
                if steps.due:  # to be saved
                    steps.save()
            elif self.limit.action == "stop":
                return failure or SolveFailed(
                    Status.INACCURATE, steps.state.t, excess.block, excess.reason)
            else:
                steps.roll_back(accepted)
                if self.limit.action == "fall_back" or not with_more_atoms(
                        self, self.monitor, steps, excess):
                    fall_back(self, steps, replace(excess, t=steps.state.t))
            accepted = steps.accepted()
        return None


def fall_back(control: ErrorControl, steps: RunSteps, why: Exceeded) -> None:
    """Goes on at full order. Raises SolveFailed where an operator cannot be factorized."""
    run, recorder, begun = steps.run, steps.recorder, time.perf_counter()
    start = _full_state(run, steps.state)
    assert recorder.errors is not None
    full = at_full_order(run, why)
    recorder.switch_run(full, {})
    recorder.errors.exact = True
    state, memory = started(full.solver, run.scene.integrator, start)
    steps.stats.full_seconds += time.perf_counter() - begun
    control.monitor_by(steps, None)
    steps.switch_run(full, state, memory)


def with_more_atoms(
    control: ErrorControl, monitor: ErrorMonitor, steps: RunSteps, why: Exceeded
) -> bool:
    """Takes some steps at full order, and goes on with atoms that represent them; False, with
    nothing changed, where that is not possible, as with complete bases."""
    run, recorder, stats, begun = steps.run, steps.recorder, steps.stats, time.perf_counter()
    model, errors, scene, state = run.model, recorder.errors, run.scene, steps.state
    assert model is not None and errors is not None
    full_bases = {n for n, d in run.solver.dictionaries.items() if complete(d)}
    if why.block in full_bases or full_bases == set(run.solver.dictionaries):
        return False
    count = -(-STEPS // monitor.every) * monitor.every - stats.done % monitor.every
    if len(run.header.enriched) == MOST or count >= steps.steps - stats.done:
        return False
    full = at_full_order(run, why).solver
    taken = list(iterate(
        step_of(full, scene.integrator, scene.time.step),
        *started(full, scene.integrator, _full_state(run, state)), count))
    if not taken[-1].outcome.status.ok:
        return False
    states, old = [one.state for one in taken], run.solver.dictionaries
    permitted = {n: LEFT_OUT * monitor.limit.tolerance * c for n, c in errors.changes.items()
                 if n in old}
    try:
        new = enriched(run, with_new_atoms(old, states, model.layout, permitted), state.t)
    except (InputError, SolveFailed):
        return False
    assert new.estimator is not None
    solver, layout = new.solver, new.solver.layout
    now, memory = started(solver, scene.integrator, states[-1])
    recorder.switch_run(new, coefficient_maps(old, solver.dictionaries))
    errors.exact, supports = True, solver.supports(memory)
    for one in taken:
        stats.add(one.seconds, one.outcome)
        stats.full_steps += 1
        reduced = in_atoms(one.state, layout, model.layout, solver.dictionaries)
        recorder.take(reduced, stats, supports, memory)
        if steps.manager.has_observers:
            steps.manager.hook.on_step(
                step=stats.done, t=reduced.t, x=reduced.x, outcome=one.outcome)
    recorder.flush()
    recorder.errors = ErrorRecord(
        new.estimator, errors.estimator.corrected(states[-1], errors.memory), now, errors.changes)
    stats.full_seconds += time.perf_counter() - begun
    control.monitor_by(steps, ErrorMonitor(
        control.limit, new, solver.start(run.start)[0], recorder.errors.changes))
    steps.switch_run(new, now, memory, many_steps(
        solver, scene.integrator, scene.time.step, steps.steps))
    return True


def _full_state(run: PreparedRun, state: State) -> State:
    assert run.model is not None
    return expanded(state, run.solver.layout, run.solver.dictionaries, run.model.layout)
