"""Jobs of a reproduction: one run or one study each, stored in a folder and never repeated while
the folder holds it."""

import json
import shlex
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sparsemor.core.analysis.study.jobs import keep_reference
from sparsemor.core.analysis.study.plan import Plan
from sparsemor.core.analysis.study.run import run_plan
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.protocols.reducer import is_full_order
from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.files.listing import remove_listed, write_listed
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.core.scene.run_identity import Identity
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.scene.source import Source
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.training import training_steps
from sparsemor.core.status import SolveFailed, Status
from sparsemor.plugins.liang2026.paper import Item, PaperFile, RunEntry, StudyEntry
from sparsemor.plugins.liang2026.split import profiled

SPLIT = "split.json"


@dataclass(frozen=True, slots=True)
class Job:
    """One run or study of a paper file, and the folder where it is stored."""

    name: str
    folder: str
    entry: RunEntry | StudyEntry
    quick: bool
    profiled: bool = False
    """True if the split of its computing time is needed."""
    matrix: tuple[str, ...] = ()
    """Functions that count as matrix operations, `file.py:Class.name`."""
    rows: tuple[Mapping[str, Any], ...] = ()
    """Rows of a study that items read."""


def jobs_of(file: PaperFile, items: Sequence[Item], out: Path, quick: bool) -> list[Job]:
    """Jobs of the runs and studies that these items need, and of the runs that those wait for:
    runs that others wait for first, then studies, which take longest, then the other runs."""
    entries: Mapping[str, RunEntry | StudyEntry] = {**file.runs, **file.studies}
    names = {n for i in items for n in (*i.runs, *i.studies)}
    first = {entries[n].after for n in names if entries[n].after}
    split = {n for i in items for v in i.values.values() for n in v.of.profiled()}
    ordered = [*(n for n in file.runs if n in first), *(n for n in file.studies if n in names),
               *(n for n in file.runs if n in names - first)]
    return [Job(n, str(folder_of(out, n, n in file.runs)), entries[n], quick, n in split,
                tuple(file.matrix_operations), tuple(file.rows_read(n))) for n in ordered]


def folder_of(out: Path, name: str, run: bool) -> Path:
    """Folder of a run or study."""
    return out / ("runs" if run else "studies") / name


def command_of(name: str, entry: RunEntry | StudyEntry, quick: bool) -> str:
    """Command that repeats a run or study alone."""
    if isinstance(entry, StudyEntry):
        return f"sparsemor study {entry.study}" + " (of it, the runs that items read)" * quick
    changes = {**entry.changes, **(entry.quick if quick else {})}
    settings = "".join(f" --set {shlex.quote(f'{key}={_written(value)}')}"
                       for key, value in changes.items())
    return f"sparsemor run {entry.scene}{settings}"


def _written(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def execute(job: Job) -> str:
    """Executes a job unless its folder holds it already; returns "" or the reason why it failed.

    A run that stops early, such as a diverged one, is a result, not a failure. Raises
    KeyboardInterrupt if the user interrupts the job.
    """
    return _reason(_execute_run if isinstance(job.entry, RunEntry) else _execute_study, job)


def profile(job: Job) -> str:
    """Splits the computing time of a completed run unless that has been done; otherwise as
    `execute`."""
    return _reason(_profile_run, job)


def _reason(work: Callable[[Job, Any], None], job: Job) -> str:
    """Reason why a piece of work failed, "" if it did not."""
    try:
        with fixed_threads():
            work(job, job.entry)
    except SolveFailed as error:
        if error.status is Status.INTERRUPTED:
            raise KeyboardInterrupt from None
        return str(error)
    except InputError as error:
        return "; ".join(str(error).splitlines())
    except Exception as error:  # a fault in one job must not end the others
        traceback.print_exc(file=sys.stderr)
        return f"{type(error).__name__}: {error}"
    return ""


def scene_of(entry: RunEntry, quick: bool) -> Scene:
    """Scene of a run, with its changes."""
    return load(entry.scene, {**entry.changes, **(entry.quick if quick else {})})


def _execute_run(job: Job, entry: RunEntry) -> None:
    scene, folder = scene_of(entry, job.quick), Path(job.folder)
    kept = completed(scene, folder)
    if kept is None:
        remove_listed(folder, SPLIT)
        kept = _simulated(scene, folder)
    if kept.status.ok and is_full_order(scene.reducer):
        keep_reference(scene, folder)


def _profile_run(job: Job, entry: RunEntry) -> None:
    scene, folder = scene_of(entry, job.quick), Path(job.folder)
    kept = completed(scene, folder)
    if kept is not None and kept.status.ok and not (folder / SPLIT).is_file():
        split = profiled(scene, entry.profile, job.matrix)
        write_listed(folder, SPLIT, (json.dumps(split) + "\n").encode())


def completed(scene: Scene, folder: Path) -> RunResult | None:
    """Stored result of this scene, finished or stopped by itself; None if there is none."""
    if not OutputDirectory(folder).is_result():
        return None
    kept = open_result(folder)
    same = kept.attributes["scene_digest"] == scene.digest() and not Identity.of(scene).changes(
        kept.attributes.get("identity", {}))
    return kept if same and kept.summary and kept.status is not Status.INTERRUPTED else None


def _simulated(scene: Scene, folder: Path) -> RunResult:
    """Result of a run in `folder`, continued where an interrupted run of the same scene left it."""
    teacher = training_steps(scene) > 0
    if OutputDirectory(folder).is_result():
        try:
            return simulate(scene, out=folder, resume=True)
        except InputError:  # another scene or program: computed again
            OutputDirectory(folder).remove_result()
        except SolveFailed as error:
            return _stopped(error)
    try:
        return simulate(scene, out=folder, keep_training=teacher)
    except SolveFailed as error:
        return _stopped(error)


def _stopped(error: SolveFailed) -> RunResult:
    if error.status is Status.INTERRUPTED or not isinstance(error.result, RunResult):
        raise error
    return error.result


def _execute_study(job: Job, entry: StudyEntry) -> None:
    folder = Path(job.folder)
    plan = plan_of(entry, job.rows, job.quick, folder.with_name(f"{folder.name}.yaml"))
    try:
        run_plan(plan, out=folder)
    except InputError as error:
        if not any(f.key == "out" for f in error.faults):
            raise
        run_plan(plan, out=folder, force=True)  # of another version of the study or program


def plan_of(
    entry: StudyEntry, rows: Sequence[Mapping[str, Any]], quick: bool, changed: Path
) -> Plan:
    """Plan of a study; with `quick`, of the runs of it that items read, `rows`, and with the keys
    that the entry replaces, written to the file `changed`."""
    if not quick:
        return Plan.of(entry.study)
    if not entry.quick:
        return Plan.of(entry.study).only(rows)
    tree = dict(Source.read(entry.study, Registry(), "study").tree)
    for key, value in entry.quick.items():
        tree[key] = {**tree.get(key, {}), **value} if key in ("set", "grid") else value
    changed.parent.mkdir(parents=True, exist_ok=True)
    write_listed(changed.parent, changed.name,  # JSON is YAML
                 (json.dumps(tree, indent=1) + "\n").encode())
    return Plan.of(str(changed)).only(rows)
