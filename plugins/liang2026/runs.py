"""Runs and studies of a reproduction, executed by the study engine and stored in its folder, where
nothing that is complete is repeated."""

import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from sparsemor.core.errors import InputError
from sparsemor.core.linalg.threads import fixed_threads
from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.scene.source import Source
from sparsemor.core.status import SolveFailed, Status
from sparsemor.plugins.liang2026.computing_time_split import SPLIT, write_split
from sparsemor.plugins.liang2026.item_functions import reason_of
from sparsemor.plugins.liang2026.paper import PaperFile, PaperItem, RunEntry, StudyEntry
from sparsemor.plugins.liang2026.quantities import split
from sparsemor.plugins.publishing.listed_files import add_part, remove_listed, write_listed
from sparsemor.plugins.study.jobs import UNCOMPUTED, completed, scene_data
from sparsemor.plugins.study.plan import Drawing, Run, StudyPlan
from sparsemor.plugins.study.run_study import run_plan, worker_pool
from sparsemor.plugins.study.scheduler import Row, Schedule, StudyProgress
from sparsemor.plugins.study.study_file import Study

RUNS, STUDIES = "runs", "studies"


@dataclass(slots=True)
class PaperRuns:
    """The runs and studies that some items of a paper need, and the runs that those wait for.

    failed: name -> reason why one could not be made; on_progress: called with a line when one has
    ended.
    """

    file: PaperFile
    items: Sequence[PaperItem]
    folder: Path
    quick: bool
    on_progress: Callable[[str], None]
    failed: dict[str, str] = field(default_factory=dict)
    _done: int = 0

    def execute(self, workers: int) -> None:
        """Makes all runs, then all studies, then the profiled passes, each with no other work
        beside it; workers: number of processes, 1 for none but this one."""
        wanted = {n for i in self.items for n in (*i.runs, *i.studies)}
        first = {self.file.entries[n].after for n in wanted} - {""}
        runs = {n: e for n, e in self.file.runs.items() if n in wanted | first}
        studies = {n: e for n, e in self.file.studies.items() if n in wanted}
        count, processes = len(runs) + len(studies), 0 if workers == 1 else workers
        for kind, name in [*((RUNS, n) for n in runs), *((STUDIES, n) for n in studies)]:
            add_part(self.folder, f"{kind}/{name}")
        plan = self._plan(runs, count)

        def watched(state: StudyProgress, row: Row | None) -> None:
            if row is not None:
                name, status = plan.runs[row["run"] - 1].name, row["status"]
                stored = OutputDirectory(self.folder / RUNS / name).is_result()
                self._ended(name, row["message"] if status in UNCOMPUTED or not stored else "",
                            count, "runs and studies")

        (self.folder / RUNS).mkdir(exist_ok=True)
        with worker_pool(processes, self.folder) as (pool, scratch):
            Schedule(plan, plan.runs, pool, (), scratch, str(self.folder / RUNS)).go(
                lambda row: None, watched)
        for name, entry in studies.items():
            self._ended(name, _reason(partial(self._study, name, entry, processes)), count,
                        "runs and studies")
        timed = {n for i in self.items for v in i.values.values()
                 if type(v.of).function is split for n in v.of.runs}
        for name in [n for n in runs if n in timed and n not in self.failed]:
            self._ended(name, _reason(partial(self._profile, name)), len(timed), "runs timed")

    def _plan(self, runs: Mapping[str, RunEntry], count: int) -> StudyPlan:
        """Plan of the runs; those whose scene is refused have failed. The snapshots of a run that
        others wait for are kept in the cache (`offered`). count: number of runs and studies, for
        the progress."""
        offered = {e.after for e in self.file.entries.values()}
        found: list[Run] = []

        def add(name: str, entry: RunEntry) -> None:
            scene = scene_of(entry, self.quick)
            # a run that is made again is profiled again
            if completed(scene, self.folder / RUNS / name) is None:
                remove_listed(self.folder / RUNS / name, SPLIT)
            found.append(Run(
                len(found) + 1, {}, scene.reducer_name, scene.seed, scene_data(scene), name=name,
                after=(entry.after,), offered=name in offered))

        for name, entry in runs.items():
            if reason := _reason(partial(add, name, entry)):
                self._ended(name, reason, count, "runs and studies")
        study = Study.read({"scene": "of each run", "reference": "none", "list": [{}]}, Registry())
        return StudyPlan(
            study, tuple(found), {}, (), (), (), "", Drawing(study.name, (), "", ()))

    def _study(self, name: str, entry: StudyEntry, processes: int) -> None:
        folder = self.folder / STUDIES / name
        plan = plan_of(entry, self.file.rows_read(name), self.quick,
                       folder.with_name(f"{name}.yaml"))
        try:
            run_plan(plan, out=folder, workers=processes)
        except InputError as error:
            if not any(f.key == "out" for f in error.faults):
                raise  # else of another version of the study or program
            run_plan(plan, out=folder, workers=processes, force=True)

    def _profile(self, name: str) -> None:
        """Splits the computing time of a completed run unless that has been done."""
        entry, folder = self.file.runs[name], self.folder / RUNS / name
        scene = scene_of(entry, self.quick)
        kept = completed(scene, folder)
        if kept is not None and kept.status.ok and not (folder / SPLIT).is_file():
            write_split(folder, scene, entry.profile, self.file.matrix_operations)

    def _ended(self, name: str, reason: str, count: int, what: str) -> None:
        self._done = 1 if self._done >= count else self._done + 1
        self.on_progress(f"{self._done} of {count} {what}: {name}{': ' * bool(reason)}{reason}")
        if reason:
            self.failed[name] = reason


def _reason(work: Callable[[], object]) -> str:
    """Reason why a piece of work failed, "" if it did not. Raises KeyboardInterrupt if the user
    interrupts it."""
    try:
        with fixed_threads():
            work()
    except SolveFailed as error:
        if error.status is Status.INTERRUPTED:
            raise KeyboardInterrupt from None
        return str(error)
    except Exception as error:  # a fault in one must not end the others
        return reason_of(error)
    return ""


def scene_of(entry: RunEntry, quick: bool) -> Scene:
    """Scene of a run, with its changes."""
    return load(entry.scene, {**entry.changes, **(entry.quick if quick else {})})


def plan_of(
    entry: StudyEntry, rows: Sequence[Mapping[str, Any]], quick: bool, changed: Path
) -> StudyPlan:
    """Plan of a study; with `quick`, of the runs of it that items read, `rows`, and with the keys
    that the entry replaces, written to the file `changed`."""
    if not quick:
        return StudyPlan.read(entry.study)
    if not entry.quick:
        return StudyPlan.read(entry.study).only(rows)
    tree = dict(Source.read(entry.study, Registry(), "study").tree)
    for key, value in entry.quick.items():
        tree[key] = {**tree.get(key, {}), **value} if key in ("set", "grid") else value
    changed.parent.mkdir(parents=True, exist_ok=True)
    write_listed(changed.parent, changed.name,  # JSON is YAML
                 (json.dumps(tree, indent=1) + "\n").encode())
    return StudyPlan.read(str(changed)).only(rows)


def commands_of(file: PaperFile, item: PaperItem, quick: bool) -> list[str]:
    """Commands that recompute an item: the first with its verdict, the others its runs and studies
    alone."""
    return [f"sparsemor reproduce --items {item.id}{' --quick' * quick}",
            *(command_of(file.entries[n], quick) for n in (*item.runs, *item.studies))]


def command_of(entry: RunEntry | StudyEntry, quick: bool) -> str:
    """Command that repeats a run or study alone."""
    if isinstance(entry, StudyEntry):
        return f"sparsemor study {entry.study}" + " (of it, the runs that items read)" * quick
    changes = {**entry.changes, **(entry.quick if quick else {})}
    written = {k: v if isinstance(v, str) else json.dumps(v) for k, v in changes.items()}
    return f"sparsemor run {entry.scene}" + "".join(
        f" --set {shlex.quote(f'{key}={text}')}" for key, text in written.items())
