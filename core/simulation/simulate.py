"""Simulation of a scene: model, training, bases, step solver, checks, steps, result."""

import time
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.registry.boundary import naming_plugins
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.results.files.replaceable_files import STORE
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.output_lock import owned
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.stored_arrays import read_header
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.memory.estimate import room_for_result
from sparsemor.core.simulation.memory.limits import MemoryUse, peak
from sparsemor.core.simulation.progress import progress_bar
from sparsemor.core.simulation.recorder import Recorder, StepStatistics, admit, kept
from sparsemor.core.simulation.run_steps import RunSteps
from sparsemor.core.simulation.stages_before_steps import (
    build_bases,
    checked,
    explicit,
    prepared,
    reduced,
    train,
)
from sparsemor.core.simulation.training import snapshot_collector


@naming_plugins()
@fixed_threads()
def simulate(
    scene: Scene, *, out: str | Path | None = None, resume: bool = False,
    observers: Sequence[object] = (), cache: Cache | None = None,
    body_cache: BodyCache | None = None, keep_training: bool = False, progress: bool = False,
    estimate: bool = False,
) -> RunResult:
    """Run a scene and store its result under `out`; when not given, in a temporary directory that
    is removed with the result, at the latest when this process ends.

    Raises InputError before anything is written, also when another run is writing to `out`;
    SolveFailed (with the results up to there in `.result`) when the run stops before its end;
    OSError when the result cannot be written, or `out` was moved or removed. resume: continue from
    the last checkpoint, also a run that has ended if `time.end` is later now. body_cache: bodies
    that other runs have built, for reuse. keep_training: a full-order run that begins with the
    training run of its scene leaves the snapshots in the cache, for reduced runs that follow.
    progress: show a progress bar on standard error. estimate: estimate the error of the run where
    its reducer leaves that open; a run that is resumed does if it did from its start.
    """
    if resume and out is None:
        raise InputError("resume needs the directory of the result to continue", "out")
    with nullcontext() if out is None else owned(Path(out)), progress_bar(progress) as bar:
        begun, manager = time.perf_counter(), new_manager((*observers, *bar))
        cache, body_cache = cache or Cache(), body_cache or BodyCache()
        scene = explicit(scene, cache, manager, body_cache)
        if out is not None:
            admit(scene, Path(out), resume)
        model, offline = prepared(scene, cache, manager, body_cache)
        temporary = TemporaryFolder() if out is None else None
        folder = Path(out or "") if temporary is None else temporary.path
        if not resume:  # what is left to write is less than the whole
            room_for_result(scene, model, folder)
        train(scene, model, offline)
        build_bases(scene, model, offline)
        every = int(read_header(folder / STORE)["attributes"]["estimates_every"]) if resume else 0
        run = checked(reduced(scene, model, offline, every > 0 if resume else estimate, every))
        stats = StepStatistics(offline=time.perf_counter() - begun)
        recorder = Recorder.open(run, folder, resume, offline.products)
        recorder.folder, recorder.memory = temporary, MemoryUse(offline.expected, peak())
        # snapshots are those of a whole run: not of the rest of an interrupted one
        snapshots = None
        if keep_training and not resume:
            snapshots = snapshot_collector(scene, model, offline)
        with kept(recorder.writer, new=recorder.checkpoint is None):
            steps = RunSteps(run, recorder, manager, stats, snapshots)
            failure = steps.take()
            result = steps.finish(failure)
        if snapshots is not None:
            online = result.summary["wall_s"]["online"]
            offline.keep_training(snapshots.finished(), snapshots.share * online)
        return result
