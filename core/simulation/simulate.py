"""Simulation of a scene: assembles the model, prepares the reducer, runs the time loop, stores."""

import time
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.model.body_cache import BodyCache
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import RedrawsRows, State, StepMemory
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.registry.hooks import Manager, new_manager
from sparsemor.core.registry.returned_values import complete
from sparsemor.core.results.files.temporary import TemporaryFolder
from sparsemor.core.results.output_lock import owned
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.store import ResultWriter
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.admission import admit, kept
from sparsemor.core.simulation.advice import explicit
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.error_control.actions import ErrorWatch, Exceeded, at_full_order
from sparsemor.core.simulation.error_control.notes import error_limit
from sparsemor.core.simulation.error_control.record import ErrorRecord
from sparsemor.core.simulation.memory.limits import peak
from sparsemor.core.simulation.memory.use import MemoryUse
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.prepare import prepared_run
from sparsemor.core.simulation.prepared_run import PreparedRun
from sparsemor.core.simulation.progress import progress_bar
from sparsemor.core.simulation.recorder import Recorder
from sparsemor.core.simulation.run_steps import RunSteps
from sparsemor.core.simulation.step_statistics import Tally
from sparsemor.core.simulation.time_stepping import many_steps, started
from sparsemor.core.simulation.training import SnapshotKeeper, training_steps
from sparsemor.core.status import SolveFailed


@naming_plugins()
@fixed_threads()
def simulate(
    scene: Scene, *, out: str | Path | None = None, resume: bool = False,
    observers: Sequence[object] = (), cache: Cache | None = None,
    body_cache: BodyCache | None = None, keep_training: bool = False, progress: bool = False,
) -> RunResult:
    """Run a scene and store its result under `out`; when not given, in a temporary directory that
    is removed with the result, at the latest when this process ends.

    Raises InputError before anything is written, also when another run is writing to `out`;
    SolveFailed (with the results up to there in `.result`) when the run stops before its end;
    OSError when the result cannot be written, or `out` was moved or removed. resume: continue from
    the last checkpoint, also a run that has ended if `time.end` is later now. body_cache: bodies
    that other runs have built, for reuse. keep_training: a full-order run that begins with the
    training run of its scene leaves the snapshots in the cache, for reduced runs that follow.
    progress: show a progress bar on standard error.
    """
    with nullcontext() if out is None else owned(Path(out)), progress_bar(progress) as bar:
        return _simulate(
            scene, out, resume, (*observers, *bar), cache, body_cache, keep_training)


def _simulate(
    scene: Scene, out: str | Path | None, resume: bool, observers: Sequence[object],
    cache: Cache | None, body_cache: BodyCache | None, keep_training: bool,
) -> RunResult:
    begun = time.perf_counter()
    manager, cache = new_manager(observers), cache or Cache()
    body_cache = body_cache or BodyCache()
    scene = explicit(scene, cache, manager, body_cache)
    if out is not None:
        admit(scene, Path(out), resume)
    elif resume:
        raise InputError("resume needs the directory of the result to continue", "out")
    folder = TemporaryFolder() if out is None else None
    path = folder.path if folder is not None else Path(out or "")
    run, offline = prepared_run(  # what is left to write is less than the whole
        scene, cache, manager, body_cache, None if resume else path)
    tally = Tally(offline=time.perf_counter() - begun)
    recorder = Recorder.open(run, path, resume, step_count(scene), offline.products)
    recorder.memory = MemoryUse(offline.expected, peak())
    assert run.model is not None and isinstance(recorder.writer, ResultWriter)
    # snapshots are those of a whole run: not of the rest of an interrupted one
    keeper = _keeper(scene, run.model, offline) if keep_training and not resume else None
    with kept(recorder.writer, new=recorder.checkpoint is None):
        try:
            result = stepped(run, recorder, manager, tally, keeper)
        except SolveFailed as error:
            if folder is not None and isinstance(error.result, RunResult):
                error.result.held_in(folder)
            raise
    if folder is not None:
        result.held_in(folder)
    if keeper is not None:
        offline.keep_training(keeper.finished(), keeper.share * result.summary["wall_s"]["online"])
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
        return RunSteps(run, recorder, manager, state, memory, tally, keeper, many, watch).go()


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
