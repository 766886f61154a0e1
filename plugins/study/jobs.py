"""Jobs of a study: a reference run, offline products (training run and bases) shared by runs, or
one run.

Jobs and results are plain data that can be sent to any process or machine.
"""

import logging
import os
import shutil
import sys
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.core import ReducedProblem
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.model.model import Model
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.checkpoint import checkpoint_file
from sparsemor.core.results.files.replaceable_files import STORE, own_files, remove
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.json_data import finite
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.core.results.stored_arrays import StoredArrays
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.run_identity import Identity, physics_of
from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.scene.source import Source
from sparsemor.core.scene.yaml_reader import Document
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline_cache import mesh_content
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.stages_before_steps import explicit, prepared
from sparsemor.core.simulation.training import TRAINING
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.status import SolveFailed, Status
from sparsemor.plugins.kept_models.reduced_model import ReducedModel, reduce
from sparsemor.plugins.study.quantities import QuantityOfInterest
from sparsemor.plugins.study.table_columns import RESULT, measured

_log = logging.getLogger(__name__)
REFUSED, BROKEN, DIED = "refused", "error", "worker_died"
"""Outcomes of a run in addition to the values of `Status`: invalid input, exception in the code,
lost worker."""
UNCOMPUTED = (REFUSED, BROKEN, DIED)
"""Outcomes that are no results."""


def execute(job: Mapping[str, Any], registry: Registry | None = None) -> dict[str, Any]:
    """Executes a job and returns its result; failures are returned in it, not raised.

    job: plain data with its `kind` (reference, products or run) and its `scene` (`scene_data`).
    Raises KeyboardInterrupt if the user interrupts the run.
    """
    try:
        with fixed_threads():
            answer = _KINDS[job["kind"]](job, scene_of(job["scene"], registry), registry)
    except InputError as error:
        answer = {"status": REFUSED, "message": _one_line(str(error))}
    except SolveFailed as error:
        if error.status is Status.INTERRUPTED:
            raise KeyboardInterrupt from None
        answer = {"status": error.status.value, "message": str(error)}
    # a fault in some plugin's code must not end the runs of the others
    except Exception as error:
        traceback.print_exc(file=sys.stderr)
        answer = {"status": BROKEN, "message": _one_line(f"{type(error).__name__}: {error}")}
    return dict(finite(answer))


def scene_data(scene: Scene) -> dict[str, Any]:
    """Scene as plain data, from which another process builds it by `scene_of`."""
    source = scene.source
    return {"tree": source.tree, "name": source.document.name, "folder": str(scene.folder)}


def scene_of(data: Mapping[str, Any], registry: Registry | None = None) -> Scene:
    """Scene built from the plain data of `scene_data`."""
    tree = dict(data["tree"])
    document = Document(str(data["name"]), tree)
    return build(Source(document, tree, registry or Registry(), Path(data["folder"])))


def _reference(
    job: Mapping[str, Any], scene: Scene, registry: Registry | None
) -> dict[str, Any]:
    key, result = cached_reference(scene, job.get("keep_training", False))
    return {"status": result.status.value, "key": key}


def _products(job: Mapping[str, Any], scene: Scene, registry: Registry | None) -> dict[str, Any]:
    """Computes the training run and bases shared by several runs, by preparing one of these runs;
    they are stored in the cache.

    Raises SolveFailed only if the training run fails; other failures are reported by each run
    itself.
    """
    scene = explicit(scene, Cache(), new_manager())  # with what trial runs choose for it
    model, offline = prepared(scene, Cache(), new_manager())
    with np.errstate(all="ignore"):
        try:
            scene.reducer.prepare(ReducedProblem(
                model, scene.integrator, scene.time.step, offline,
                np.random.default_rng(scene.seed)))
        except InputError:
            pass
        except SolveFailed as error:
            if error.status is Status.INTERRUPTED or error.phase == TRAINING:
                raise
    return {"status": Status.DONE.value}


def _run(job: Mapping[str, Any], scene: Scene, registry: Registry | None) -> dict[str, Any]:
    """Row of one run: reused from the reference, continued, from a shared model, or simulated; its
    result is kept if wanted.

    Keys of the job: reference, reference_key: scene of its reference, None if it has none, and key
    of that in the cache; is_reference: True if the run is its own; keep: folder of the result, None
    if only the numbers of the row stay; scratch: folder for it until then; continue: go on with an
    interrupted result in `keep`; offered: keep a full-order run as a reference; model: prepared
    model that it may share, None for its own.
    """
    reference = None if job["reference"] is None else _stored_reference(
        scene_of(job["reference"], registry), job["reference_key"])
    table = partial(measured, reference=reference, errors_from=job["errors_from"], quantities={
        name: QuantityOfInterest.model_validate(q) for name, q in job["quantities"].items()})
    if job["keep"] is not None and not Path(job["keep"]).parent.is_dir():
        raise InputError(f"this machine does not have {Path(job['keep']).parent}, where the study "
                         "keeps its results: use a folder that all workers share")
    folder = {} if job["keep"] is None else {RESULT: "/".join(Path(job["keep"]).parts[-2:])}
    if job["is_reference"] and reference is not None:
        if job["keep"] is not None:
            shutil.copytree(reference.path, Path(job["keep"], STORE), copy_function=_linked,
                            dirs_exist_ok=True)
        return table(reference, failure=reference.summary.get("message", "")) | folder
    if job.get("continue"):
        return table(_continued(scene, Path(job["keep"]), job["offered"]), failure="") | folder
    with _place(job["keep"], job["scratch"]) as place:
        failure, model = "", _model_for(scene, job.get("model"), registry)
        try:
            result = simulate(scene, out=place) if model is None else model.run(scene, out=place)
        except SolveFailed as error:
            if error.status is Status.INTERRUPTED or not isinstance(error.result, RunResult):
                raise
            result, failure = error.result, str(error)
        prepared = None if model is None else model.offline_seconds
        return table(result, failure=failure, prepared=prepared) | folder


def _model_for(
    scene: Scene, base: Mapping[str, Any] | None, registry: Registry | None
) -> ReducedModel | None:
    """Model that the run of a scene shares with others, which is prepared from the scene `base`
    whatever run comes first; None if it needs its own."""
    model = None if base is None else shared_model(SharedBase(**base), registry)
    try:
        if model is not None:
            model.check(scene)
    except InputError:
        return None
    return model


@dataclass(frozen=True, slots=True)
class SharedBase:
    """Scene, as `scene_data`, from which a model is prepared that several runs share by its key."""

    key: str
    scene: Mapping[str, Any] = field(compare=False)


@lru_cache(maxsize=4)
def shared_model(base: SharedBase, registry: Registry | None) -> ReducedModel | None:
    """Prepared model, None where it cannot be: then each run reports its own failure. A process
    keeps the last few."""
    try:
        model = reduce(scene_of(base.scene, registry), estimate=False)  # as runs of their own
    except (InputError, SolveFailed):
        return None
    return None if model.estimates_errors else model  # which runs with other loads do not


def _continued(scene: Scene, folder: Path, offered: bool) -> RunResult:
    """Result of a run in `folder`: the one that is there, continued where it was interrupted, or a
    new one if it is of another scene or program. offered: a full-order run is put into the cache as
    the reference of other studies."""
    kept = completed(scene, folder)
    try:
        if kept is None and OutputDirectory(folder).is_result():
            try:
                kept = simulate(scene, out=folder, resume=True)
            except InputError:
                OutputDirectory(folder).remove_result()
        if kept is None:
            kept = simulate(scene, out=folder, keep_training=offered)
    except SolveFailed as error:
        if error.status is Status.INTERRUPTED or not isinstance(error.result, RunResult):
            raise
        kept = error.result
    if offered and kept.status.ok and scene.reducer.full_order:
        keep_reference(scene, folder)
    return kept


def completed(scene: Scene, folder: Path) -> RunResult | None:
    """Stored result of this scene, finished or stopped by itself; None if there is none."""
    if not OutputDirectory(folder).is_result():
        return None
    kept = open_result(folder)
    identity = kept.attributes.get("identity", {})
    same = kept.attributes["scene_digest"] == scene.digest() and not Identity.from_scene(
        scene).changes(identity)
    return kept if same and kept.summary and kept.status is not Status.INTERRUPTED else None


_KINDS = {"reference": _reference, "products": _products, "run": _run}


def keep_reference(scene: Scene, folder: Path) -> None:
    """Offers a full-order run as the reference of studies with the same physics and output: its
    files are linked, or copied, to the cache."""
    entry = Cache().root / "reference" / _reference_key(scene, checked_model(scene))
    try:
        if entry.is_dir():
            return
        with TemporaryFolder(Cache().root) as scratch:
            copy = scratch / entry.name
            shutil.copytree(folder / STORE, copy / STORE, copy_function=_linked)
            entry.parent.mkdir(exist_ok=True)
            os.rename(copy, entry)
    except OSError as fault:  # a full disk: the study makes its own
        _log.warning("the reference run %s was not kept: %s", folder, fault)


def _linked(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except FileExistsError:  # somebody else's
        raise
    except OSError:  # another file system
        shutil.copy2(source, target)


def _reference_key(scene: Scene, model: Model) -> str:
    """Cache key of a reference run: digest of physics and output, versions of code and input files,
    and meshes."""
    return digest(physics_of(scene, "reference").digest(), scene.digest("output"),
                  Identity.from_scene(scene).plain(), mesh_content(model))


def _remove_damaged(key: str) -> None:
    """Removes a reference run from the cache if the checksum of one of its files does not match."""
    kept = Cache().root / "reference" / key
    try:
        if (kept / STORE).is_dir():
            StoredArrays(kept / STORE).check(whole=True)
    except InputError as fault:
        _log.warning("cache entry reference/%s is damaged (%s): made again", key, fault)
        # ours whatever its files are: nobody else makes a folder with this digest as its name
        shutil.rmtree(kept / STORE, ignore_errors=True)
        remove(own_files(kept), kept)
    except OSError:  # of another user: a miss
        pass


def cached_reference(
    scene: Scene, keep_training: bool = False, body_cache: BodyCache | None = None
) -> tuple[str, RunResult]:
    """Cache key and result of a full-order run, computed if it is not in the cache, also if it
    fails. keep_training, body_cache: as for `simulate`."""
    key = _reference_key(scene, checked_model(scene, body_cache))
    _remove_damaged(key)
    return key, _stored_reference(scene, key, keep_training, body_cache)


def _stored_reference(
    scene: Scene, key: str, keep_training: bool = False, body_cache: BodyCache | None = None
) -> RunResult:
    """Reference run from the cache; computed and cached if absent, also if it fails. Where the
    cache cannot be read or written, the result is in a temporary folder."""
    entry = Cache().root / "reference" / key
    with suppress(OSError, InputError):
        if (entry / STORE).is_dir():
            result = open_result(entry)
            _ = result.status  # raises for a result that cannot be read
            return result
    try:
        scratch = TemporaryFolder(Cache().root)
    except OSError:
        scratch = TemporaryFolder()
    fresh = scratch.path / key
    try:
        simulate(scene, out=fresh, keep_training=keep_training, body_cache=body_cache)
    except SolveFailed as error:
        if error.status is Status.INTERRUPTED or not isinstance(error.result, RunResult):
            raise
    try:
        entry.mkdir(parents=True, exist_ok=True)
        for name in (checkpoint_file(fresh / STORE).name, STORE):  # this one last: it is the mark
            os.rename(fresh / name, entry / name)
    except OSError:
        with suppress(OSError, InputError):  # another process was quicker
            result = open_result(entry)
            _ = result.status
            return result
        return open_result(fresh).held_in(scratch)
    return open_result(entry)


@contextmanager
def _place(kept: str | None, scratch: str | None) -> Iterator[Path]:
    """Context manager: folder for the result of a run. kept: folder in which it stays, None if only
    its numbers are kept; scratch: folder that is removed afterwards, None or of another machine:
    a temporary one."""
    wanted_folder = kept or scratch
    if wanted_folder is not None and Path(wanted_folder).parent.is_dir():
        folder = Path(wanted_folder)
        remove(own_files(folder), folder)  # of an attempt that was killed
        try:
            yield folder
        finally:
            if folder != Path(kept or ""):
                remove(own_files(folder), folder)
                with suppress(OSError):
                    folder.rmdir()
    else:
        with TemporaryFolder() as folder:
            yield folder


def _one_line(text: str) -> str:
    return "; ".join(text.splitlines())
