"""Execution of a study, from its plan to its table."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from os.path import lexists
from pathlib import Path
from typing import Any

from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.results.files.written_files import Listing, in_the_way, read_listing
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.status import Status
from sparsemor.plugins.publishing.listed_files import add_to_listing, list_file
from sparsemor.plugins.study.jobs import DIED
from sparsemor.plugins.study.journal import WRITES, Journal, is_study
from sparsemor.plugins.study.plan import StudyPlan
from sparsemor.plugins.study.progress import OnProgress, progress_display
from sparsemor.plugins.study.report import StudyTable
from sparsemor.plugins.study.scheduler import LostWorkers, Row, Schedule
from sparsemor.plugins.study.worker_pools import DaskPool, Pool, SerialPool

KEPT = "runs"
"""Folder of the results that are kept, in that of the study."""
WORKER = "sparsemor.plugins.study.worker"
"""Program of the worker processes."""


@dataclass(frozen=True, slots=True, eq=False)
class StudyOutcome:
    """Completed study: one row per run, sorted by run. files: tables written at the end; lost:
    workers that died in this execution."""

    plan: StudyPlan
    folder: Path
    rows: tuple[Row, ...]
    files: tuple[Path, ...]
    lost: LostWorkers

    @property
    def failed(self) -> int:
        return sum(row["status"] != Status.DONE.value for row in self.rows)


def study(
    file: str | Path | Mapping[str, Any],
    scene: str | Path | Mapping[str, Any] | None = None, *,
    overrides: Mapping[str, Any] | None = None, out: str | Path | None = None, workers: int = 0,
    scheduler: Any = None, times: bool = True, registry: Registry | None = None,
    progress: bool = False,
) -> StudyTable:
    """Executes a study and returns its table: a list of one mapping per run, in order, with charts
    (`plot()`).

    file: name of a packaged study, path, or the contents of a study file as plain data; scene:
    name, path or contents of the scene that it varies instead of its own, with changes `overrides`;
    out: output folder, by default `runs/NAME`, where a repeated call continues an incomplete study;
    workers: number of processes on this machine, 0 for none but this process; scheduler: a
    dask.distributed cluster, by its address, its scheduler file, a `Cluster` or a `Client`; times:
    include the columns that depend on the machine; progress:
    show it on standard error. Raises InputError before anything is written.
    """
    plan = StudyPlan.read(file, registry, scene, overrides)
    with progress_display(plan, not progress) as on_progress:
        done = run_plan(plan, out=out, workers=workers, scheduler=scheduler, times=times,
                        registry=registry, on_progress=on_progress)
    return StudyTable(plan, done.rows)


def run_plan(
    plan: StudyPlan, *, out: str | Path | None = None, workers: int = 0, scheduler: Any = None,
    times: bool = True, force: bool = False, registry: Registry | None = None,
    on_progress: OnProgress = lambda state, row: None,
) -> StudyOutcome:
    """Executes a prepared study plan, with a callback for progress; other arguments as in `study`.

    After a KeyboardInterrupt the committed rows remain; `force` replaces an earlier study. Raises
    InputError when another run has locked the folder.
    """
    if workers < 0:
        raise InputError(f"at least 0, for none but this process (got {workers})", "workers")
    if workers and scheduler is not None:
        raise InputError("give either --workers or --scheduler", "workers")
    folder = (Path(out) if out is not None else Path("runs", plan.study.name)).absolute()
    parts = [f"{KEPT}/{run.number}" for run in plan.runs] if plan.study.file.keep else []
    # refused before anything is written
    cluster = None if scheduler is None else DaskPool(scheduler)
    try:
        with OutputDirectory(folder).claimed(
                resume=not force, force=force, replaceable=lambda: is_study(folder),
                kind="studies only, and this is no study", writes=WRITES, parts=parts):
            journal = Journal.open(folder, plan, force)
            rows = journal.rows(drop=(DIED,))
            ended = {int(row["run"]) for row in rows}
            lost = LostWorkers()
            remaining = [run for run in plan.runs if run.number not in ended]
            if remaining:
                kept_runs = folder / KEPT if plan.study.file.keep else None
                if kept_runs is not None:
                    listed_parts = (read_listing(folder) or Listing()).parts
                    if not force and (foreign := [
                            n for n in parts if n not in listed_parts and lexists(folder / n)]):
                        raise in_the_way(folder, foreign)
                    kept_runs.mkdir(exist_ok=True)
                    add_to_listing(folder, [{"part": n} for n in parts if n not in listed_parts])
                with worker_pool(workers, folder, cluster, registry) as (pool, scratch):
                    schedule = Schedule(plan, remaining, pool, rows, scratch, str(kept_runs or ""))
                    schedule.go(journal.add, on_progress)
                    lost = schedule.lost
                rows = journal.rows()
            rows.sort(key=lambda row: int(row["run"]))
            files = journal.write_table(rows, times)
    finally:
        if cluster is not None:
            cluster.close()
    return StudyOutcome(plan, folder, tuple(rows), tuple(files), lost)


@contextmanager
def worker_pool(
    workers: int, folder: Path, cluster: Pool | None = None, registry: Registry | None = None
) -> Iterator[tuple[Pool, str | None]]:
    """Context manager: pool of workers, and a folder that they share (None for a cluster). workers:
    number of processes, 0 for jobs in this one; cluster: pool that is used instead."""
    if cluster is not None:
        yield cluster, None
        return
    from sparsemor.core.simulation.workers.local_pool import LocalPool

    log = folder / "workers.log"
    known = (read_listing(folder) or Listing()).files
    ours = not lexists(log) or log.name in known
    pool: Pool = LocalPool(workers, log, WORKER) if workers else SerialPool(registry)
    with TemporaryFolder(folder) as scratch:
        try:
            yield pool, str(scratch)
        finally:
            pool.close()
            if workers and ours:  # else somebody else's, to which we have appended
                list_file(log)
