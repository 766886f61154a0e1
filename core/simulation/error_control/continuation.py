"""Continuations of a reduced run whose estimated error is too large: at full order, or with atoms
that full-order steps need in addition."""

import time
from dataclasses import dataclass

from sparsemor.core.errors import InputError
from sparsemor.core.protocols import ManySteps, State, StepMemory
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.simulation.error_control.actions import (
    ErrorMonitor,
    Exceeded,
    at_full_order,
    expanded,
)
from sparsemor.core.simulation.error_control.enrichment import (
    LEFT_OUT,
    MOST,
    STEPS,
    coefficient_maps,
    complete,
    enriched,
    in_atoms,
    with_new_atoms,
)
from sparsemor.core.simulation.error_control.record import ErrorRecord
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.recorder import Recorder
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.step_statistics import StepStatistics
from sparsemor.core.simulation.time_stepping import iterate, many_steps, started
from sparsemor.core.status import SolveFailed


@dataclass(frozen=True, slots=True, eq=False)
class Continuation:
    """A run with another step solver, its present state and step memory. many: its blocks of
    steps, monitor: the comparison of its estimated errors, None where it has none."""

    run: PreparedRun
    state: State
    memory: StepMemory
    many: ManySteps | None = None
    monitor: ErrorMonitor | None = None


def fall_back(
    run: PreparedRun, recorder: Recorder, stats: StepStatistics, state: State, why: Exceeded
) -> Continuation:
    """The run at full order from a state on. Raises SolveFailed where an operator cannot be
    factorized."""
    begun, start = time.perf_counter(), _full_state(run, state)
    assert recorder.errors is not None
    full = at_full_order(run, why)
    recorder.switch_run(full, {})
    recorder.errors.exact = True
    found = Continuation(full, *started(full.solver, run.scene.integrator, start))
    stats.full_seconds += time.perf_counter() - begun
    return found


def with_more_atoms(
    run: PreparedRun, recorder: Recorder, stats: StepStatistics, manager: Manager, state: State,
    monitor: ErrorMonitor, why: Exceeded, end: int,
) -> Continuation | None:
    """Takes some steps at full order from a state, and goes on with atoms that represent them;
    None, with nothing changed, where that is not possible, as with complete bases. end: number of
    steps of the run."""
    begun, model, errors, scene = time.perf_counter(), run.model, recorder.errors, run.scene
    assert model is not None and errors is not None
    full_bases = {n for n, d in run.solver.dictionaries.items() if complete(d)}
    if why.block in full_bases or full_bases == set(run.solver.dictionaries):
        return None
    count = -(-STEPS // monitor.every) * monitor.every - stats.done % monitor.every
    if len(run.header.enriched) == MOST or count >= end - stats.done:
        return None
    full = at_full_order(run, why).solver
    steps = list(iterate(
        step_of(full, scene.integrator, scene.time.step),
        *started(full, scene.integrator, _full_state(run, state)), count))
    if not steps[-1].outcome.status.ok:
        return None
    states, old = [s.state for s in steps], run.solver.dictionaries
    permitted = {n: LEFT_OUT * monitor.limit.tolerance * c for n, c in errors.changes.items()
                 if n in old}
    try:
        new = enriched(run, with_new_atoms(old, states, model.layout, permitted), state.t)
    except (InputError, SolveFailed):
        return None
    assert new.estimator is not None
    solver, layout = new.solver, new.solver.layout
    now, memory = started(solver, scene.integrator, states[-1])
    recorder.switch_run(new, coefficient_maps(old, solver.dictionaries))
    errors.exact, supports = True, solver.supports(memory)
    for taken in steps:
        stats.add(taken.seconds, taken.outcome)
        stats.full_steps += 1
        reduced = in_atoms(taken.state, layout, model.layout, solver.dictionaries)
        recorder.take(reduced, stats, supports, memory)
        if manager.has_observers:
            manager.hook.on_step(
                step=stats.done, t=reduced.t, x=reduced.x, outcome=taken.outcome)
    recorder.flush()
    recorder.errors = ErrorRecord(
        new.estimator, errors.estimator.corrected(states[-1], errors.memory), now, errors.changes)
    stats.full_seconds += time.perf_counter() - begun
    return Continuation(
        new, now, memory, many_steps(solver, scene.integrator, scene.time.step, end),
        ErrorMonitor(monitor.limit, new, solver.start(run.start)[0], recorder.errors.changes))


def _full_state(run: PreparedRun, state: State) -> State:
    assert run.model is not None
    return expanded(state, run.solver.layout, run.solver.dictionaries, run.model.layout)
