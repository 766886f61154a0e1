"""Scheduler of a study's jobs: reference runs and shared offline products first, then the runs.

A run waits for the reference and offline products that it shares with others, so that nothing is
computed twice.
"""

import heapq
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from typing import Any, Literal

from sparsemor.core.simulation.workers.local_pool import EndedJob
from sparsemor.core.status import Status
from sparsemor.plugins.study.jobs import BROKEN, DIED, REFUSED
from sparsemor.plugins.study.plan import Run, StudyPlan
from sparsemor.plugins.study.worker_pools import Pool

Row = dict[str, Any]
Answer = dict[str, Any]


@dataclass(frozen=True, slots=True)
class StudyProgress:
    """Progress of a study: numbers of runs. seconds_left: estimated remaining time, None while it
    cannot be estimated; lost: number of workers that died."""

    total: int
    done: int
    failed: int
    running: int
    seconds_left: float | None
    lost: int = 0


@dataclass(frozen=True, slots=True)
class LostWorkers:
    """Workers that died during the execution of a study. runs: numbers of the runs that were
    repeated therefore; shared: number of repeated reference runs and offline products."""

    count: int = 0
    runs: tuple[int, ...] = ()
    shared: int = 0

    def __str__(self) -> str:
        """Such as `2 workers lost, repeated: run 7, run 12, 1 reference or shared product`."""
        again = [f"run {n}" for n in self.runs[:NAMED]]
        if len(self.runs) > NAMED:
            again.append(f"{len(self.runs) - NAMED} other runs")
        if self.shared:
            again.append(f"{self.shared} reference or shared product{'s' * (self.shared > 1)}")
        return (f"{self.count} worker{'s' * (self.count != 1)} lost"
                f"{', repeated: ' * bool(again)}{', '.join(again)}")


NAMED = 20
"""Maximum number of repeated runs that are named in a report."""
Kind = Literal["reference", "products", "run"]


@dataclass(frozen=True, slots=True)
class _Job:
    """Job that computes the item `key` of a kind. after: names of jobs it depends on; run: a run
    that needs the item."""

    kind: Kind
    key: str
    after: tuple[str, ...]
    run: Run

    @property
    def name(self) -> str:
        return f"{self.kind}:{self.key}"


class Schedule:
    """Execution of the remaining runs of a study, in the order of their dependencies.

    left: runs without a row; earlier: rows of earlier executions; scratch: temporary folder for
    results that all workers can access, or None; kept: folder of the results that are kept, "" for
    none.
    """

    def __init__(
        self, plan: StudyPlan, left: Sequence[Run], pool: Pool,
        earlier: Sequence[Mapping[str, Any]], scratch: str | None, kept: str = "",
    ) -> None:
        """left: runs without a row; earlier: rows of earlier executions, for the progress; scratch:
        folder for results that are not kept, None where workers have no common one; kept: folder of
        the results that are, "" for none."""
        self._plan, self._pool, self._scratch, self._kept = plan, pool, scratch, kept
        self._jobs = {job.name: job for job in _jobs_of(left)}
        self._models = _shared_models(plan.runs)
        self._order = {name: i for i, name in enumerate(self._jobs)}
        self._graph = TopologicalSorter({name: job.after for name, job in self._jobs.items()})
        self._graph.prepare()
        # jobs that wait for no other one, by their place in the order
        self._ready: list[tuple[int, str]] = []
        self._push(self._graph.get_ready())
        # by name of a job: results; numbers of workers that died of it; submitted jobs
        self._answers: dict[str, Answer] = {}
        self._deaths: dict[str, int] = {}
        self._flying: set[str] = set()
        self._begun, self._ended, self._runs_left = time.monotonic(), 0, len(left)
        self._done = len(earlier)
        self._failed = sum(row["status"] != Status.DONE.value for row in earlier)

    @property
    def state(self) -> StudyProgress:
        spent = time.monotonic() - self._begun
        seconds = spent / self._ended * self._runs_left if self._ended else None
        return StudyProgress(
            len(self._plan.runs), self._done, self._failed, len(self._flying), seconds,
            self._pool.lost)

    @property
    def lost(self) -> LostWorkers:
        """Workers lost so far, and what was repeated."""
        again = [self._jobs[name] for name, deaths in self._deaths.items() if deaths]
        runs = [job.run.number for job in again if job.kind == "run"]
        return LostWorkers(self._pool.lost, tuple(sorted(runs)), len(again) - len(runs))

    def go(
        self, commit: Callable[[Row], None],
        on_progress: Callable[[StudyProgress, Row | None], None],
    ) -> None:
        """Executes jobs until every run has its row: those that wait for no other one (`_ready`)
        are submitted while the pool takes more (`_flying`: submitted). `commit`: called with each
        row; `on_progress`: called with the progress after each row, and repeatedly while jobs run.
        """
        self._commit, self._on_progress = commit, on_progress
        while self._ready or self._flying:
            while self._ready and len(self._flying) < self._pool.slots:
                self._start(heapq.heappop(self._ready)[1])
            if not self._flying:
                continue
            on_progress(self.state, None)
            ended = self._pool.next(1.0)
            if ended is not None:
                self._end(ended)

    def _push(self, names: Iterable[str]) -> None:
        for name in names:
            heapq.heappush(self._ready, (self._order[name], name))

    def _start(self, name: str) -> None:
        job = self._jobs[name]
        spoiled = next((a for n in job.after if (a := self._spoils(n)) is not None), None)
        if job.run.refused and job.kind == "run":
            spoiled = {"status": REFUSED, "message": job.run.refused}
        if spoiled is not None:
            self._settle(name, spoiled)
            return
        self._flying.add(name)
        self._pool.submit(name, self._payload(job))

    def _payload(self, job: _Job) -> dict[str, Any]:
        """Job as plain data for a worker; its keys are those that `jobs.py` reads."""
        run = job.run
        reference = self._plan.references[run.reference] if run.reference else None
        if job.kind == "reference":
            learns = any(r.learns for r in self._plan.runs if r.reference == run.reference)
            return {"kind": job.kind, "scene": reference, "keep_training": learns}
        assert run.scene is not None
        if job.kind == "products":
            return {"kind": job.kind, "scene": run.scene}
        return {
            "kind": job.kind, "scene": run.scene, "reference": reference,
            "reference_key": self._answers[f"reference:{run.reference}"]["key"]
            if reference else "",
            "is_reference": run.is_reference,
            "errors_from": self._plan.study.file.errors_from,
            "scratch": f"{self._scratch}/run-{run.label}" if self._scratch else None,
            "keep": f"{self._kept}/{run.label}" if self._kept else None,
            "continue": bool(run.name), "offered": run.offered,
            "quantities": {n: q.model_dump()
                           for n, q in self._plan.study.file.quantities.items()},
            "model": self._models.get(run.model),
        }

    def _end(self, ended: EndedJob) -> None:
        self._flying.discard(ended.name)
        answer = ended.answer
        deaths = self._deaths[ended.name] = self._deaths.get(ended.name, 0) + ended.deaths
        if answer is None:
            if deaths <= self._pool.repeats:
                self._push([ended.name])
                return
            times = f"{deaths} times, " if deaths > 1 else ""
            answer = {"status": DIED, "message": f"its worker died ({times}last: {ended.death})"}
        self._settle(ended.name, answer)

    def _settle(self, name: str, answer: Answer) -> None:
        """Records the answer of a job, releases those that waited for it, and commits the row of a
        run."""
        self._answers[name] = answer
        self._graph.done(name)
        self._push(self._graph.get_ready())
        job = self._jobs[name]
        if job.kind != "run":
            return
        row = self._row(job, answer)
        self._commit(row)
        self._done, self._ended = self._done + 1, self._ended + 1
        self._runs_left -= 1
        self._failed += row["status"] != Status.DONE.value
        self._on_progress(self.state, row)

    def _row(self, job: _Job, answer: Answer) -> Row:
        run = job.run
        own = {"run": run.number, "reducer": run.reducer, "seed": run.seed,
               "workers": self._pool.workers, "repeats": self._deaths.get(job.name, 0)}
        # an axis may be called `reducer`: its labels then stand in that column
        return own | answer | dict(run.settings)

    def _spoils(self, name: str) -> Answer | None:
        """Result for jobs that depend on the job `name`, if its failure prevents them; otherwise
        None."""
        answer = self._answers[name]
        kind, status = self._jobs[name].kind, answer["status"]
        if kind == "reference" and "key" not in answer:
            return {"status": status, "message": f"reference: {answer['message']}"}
        # a refusal may be of the one run that was prepared: the others say their own
        if kind == "products" and status not in (Status.DONE.value, REFUSED, BROKEN):
            return answer
        return None


def _shared_models(runs: Sequence[Run]) -> dict[str, dict[str, Any]]:
    """Key of each model that several runs may share -> the same key, and the scene of the first of
    them, from which it is prepared."""
    count = Counter(run.model for run in runs if run.model)
    return {run.model: {"key": run.model, "scene": run.scene} for run in reversed(runs)
            if count[run.model] > 1}


def _jobs_of(runs: Sequence[Run]) -> list[_Job]:
    """Jobs in order: reference runs, offline products shared by several runs, runs.

    Of runs with one training run, the first job of offline products computes it, and all others
    wait for that; a run that shares no bases computes its own.
    """
    possible = [run for run in runs if not run.refused]
    references = {run.reference: run for run in reversed(possible) if run.reference}
    trained: dict[str, list[Run]] = {}  # key of the training run -> runs
    for run in possible:
        if run.training:
            trained.setdefault(run.training, []).append(run)
    products: list[_Job] = []
    waits_for: dict[str, str] = {}  # key of training run and bases -> job
    for group in trained.values():
        if len(group) == 1:
            continue
        first = f"products:{group[0].products}"
        for token in dict.fromkeys(run.products for run in group):
            sharing = [run for run in group if run.products == token]
            name = f"products:{token}"
            if name != first and len(sharing) == 1:
                waits_for[token] = first  # it makes its own basis from the shared training run
                continue
            # the reference may be the training run, too
            before = first if name != first else _reference_of(sharing[0])
            products.append(_Job("products", token, (before,) if before else (), sharing[0]))
            waits_for[token] = name
    jobs = [_Job("reference", key, (), run) for key, run in reversed(references.items())] + products
    present = {run.name for run in runs}
    for run in runs:
        after = [f"run:{name}" for name in run.after if name in present]
        if not run.refused:
            shared = waits_for.get(run.products)
            after += [name for name in (_reference_of(run), shared) if name]
        jobs.append(_Job("run", run.label, tuple(after), run))
    return jobs


def _reference_of(run: Run) -> str:
    """Name of the job that computes a run's reference, "" for none."""
    return f"reference:{run.reference}" if run.reference else ""
