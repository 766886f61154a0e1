"""What a study does whatever its scene: runs in order, rows that are whole, dead workers."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sparsemor.bodies.terms.field_kinds import BODY_KINDS
from sparsemor.core.errors import InputError
from sparsemor.core.results.json_data import finite
from sparsemor.core.simulation.workers.local_pool import EndedJob
from sparsemor.plugins.study.journal import Journal
from sparsemor.plugins.study.plan import StudyPlan
from sparsemor.plugins.study.progress import duration, in_words
from sparsemor.plugins.study.scheduler import Row, Schedule, StudyProgress
from sparsemor.plugins.study.table_columns import RESERVED, TIMES, cell, columns_of
from toy_scene import TOY_SCENE
from toy_study import GRID, HEAD, planned

pytestmark = pytest.mark.usefixtures("toys")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(TOY_SCENE)


def row_of(run: int, **values: Any) -> Row:
    return {"run": run, "status": "done", "message": "", "facts": {}, **values}


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner,
                                                                 max_size=3), max_leaves=6)


@pytest.mark.full
@example(values=["\r"], cut=1)
@settings(max_examples=12)
@given(values=st.lists(PLAIN, min_size=1, max_size=5), cut=st.integers(1, 12))
def test_what_was_committed_survives_a_torn_line(values: list[Any], cut: int) -> None:
    plan = planned(HEAD + "grid: {bodies.a.mass: [1, 2, 3, 4, 5, 6]}\n")
    folder = Path("out")
    for file in folder.glob("*"):
        file.unlink()
    journal = Journal.open(folder, plan)
    journal.rows()
    rows = [row_of(n, message="a, \"b\"\n", notes=finite(v)) for n, v in enumerate(values, 1)]
    for row in rows:
        journal.add(row)
    whole = (folder / "runs.jsonl").read_bytes()
    (folder / "runs.jsonl").write_bytes(whole + whole.splitlines(keepends=True)[0][:cut])
    (folder / "runs.csv").write_bytes((folder / "runs.csv").read_bytes()[:-cut])
    again = Journal.open(folder, plan).rows()
    assert [{k: r[k] for k in ("run", "notes")} for r in again] == [
        {k: r[k] for k in ("run", "notes")} for r in rows]
    assert (folder / "runs.jsonl").read_bytes() == whole
    with (folder / "runs.csv").open(newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert [list(r.values()) for r in table] == [
        [cell(r[n]) for n in plan.columns] for r in again]


@pytest.mark.full
def test_the_folder_of_another_study_is_refused() -> None:
    plan = planned(HEAD + "grid: {seed: [1, 2]}\n")
    Journal.open(Path("out"), plan)
    Journal.open(Path("out"), planned("# a comment\n" + HEAD + "grid: {seed: [1, 2]}\n"))
    for changed in (HEAD + "grid: {seed: [1, 3]}\n", HEAD + "grid: {seed: [2, 1]}\n"):
        with pytest.raises(InputError, match="contains another study"):
            Journal.open(Path("out"), planned(changed))
    Path("scene.yaml").write_text(TOY_SCENE.replace("mass: 1", "mass: 2"))
    with pytest.raises(InputError, match="contains another study"):
        Journal.open(Path("out"), planned(HEAD + "grid: {seed: [1, 2]}\n"))
    Path("mine").mkdir()
    Path("mine/thesis.tex").touch()
    with pytest.raises(InputError, match="no study"):
        Journal.open(Path("mine"), plan)


def test_the_table_has_the_largest_fact_of_all_blocks_and_may_leave_times_out() -> None:
    plan = planned(HEAD + "grid: {seed: [1, 2]}\n")
    journal = Journal.open(Path("out"), plan)
    rows = [row_of(2, facts={"a": {"condition": 2.0}, "b": {"condition": 5, "name": "x"}},
                   ms_per_step=1.0), row_of(1)]
    rows = [{n: r.get(n) for n in plan.columns} for r in rows]
    journal.write_table(rows, times=False)
    table = [json.loads(line) for line in Path("out/table.jsonl").read_text().splitlines()]
    assert [(r["run"], r["fact.condition"]) for r in table] == [(1, None), (2, 5)]
    assert not set(table[0]) & set(TIMES)
    journal.write_table(rows, times=True)
    table = [json.loads(line) for line in Path("out/table.jsonl").read_text().splitlines()]
    assert table[1]["ms_per_step"] == 1.0


class Fake:
    """A pool that answers from a function, newest job first; None: the worker dies."""

    workers, repeats, lost = 2, 3, 0

    def __init__(self, answer: Callable[[str], dict[str, Any] | None], slots: int = 2) -> None:
        self.answer, self.slots = answer, slots
        self.given: list[str] = []
        self.flying: list[str] = []

    def submit(self, name: str, job: Any) -> None:
        assert job["kind"] == name.partition(":")[0]
        self.given.append(name)
        self.flying.append(name)
        assert len(self.flying) <= self.slots
        json.dumps(job)  # travels as plain data

    def next(self, timeout: float) -> EndedJob:
        name = self.flying.pop()
        answer = self.answer(name)
        died = int(answer is None)
        self.lost += died
        return EndedJob(name, answer, "SIGKILL" * died, deaths=died)

    def close(self) -> None:
        pass


def conducted(plan: StudyPlan, pool: Fake, lost: str = "0 workers lost") -> list[Row]:
    rows: list[Row] = []
    states: list[StudyProgress] = []
    schedule = Schedule(plan, plan.runs, pool, (), None)
    schedule.go(rows.append, lambda state, row: states.append(state))
    assert str(schedule.lost) == lost
    assert states[-1].done == len(plan.runs) == len(rows) == len({r["run"] for r in rows})
    assert states[-1].failed == sum(r["status"] != "done" for r in rows)
    assert not pool.flying
    return rows


def done(name: str) -> dict[str, Any]:
    return {"status": "done", "message": "", "key": "k"}


@pytest.mark.full
@pytest.mark.parametrize("slots", [1, 2, 7, 100])
def test_a_run_starts_after_what_it_shares(slots: int) -> None:
    plan = planned(GRID)
    pool = Fake(done, slots)
    conducted(plan, pool)
    assert len(pool.given) == len(set(pool.given)) == 6 + 24
    for run in plan.runs:
        assert pool.given.index(f"reference:{run.reference}") < pool.given.index(
            f"run:{run.number}")


def test_a_job_whose_worker_dies_is_repeated_three_times() -> None:
    plan = planned(HEAD + "grid: {seed: [1, 2, 3]}\n")
    deaths = {"run:1": 3, "run:2": 99}

    def answer(name: str) -> dict[str, Any] | None:
        deaths[name] = deaths.get(name, 0) - 1
        return done(name) if deaths[name] < 0 else None

    pool = Fake(answer)
    rows = {row["run"]: row for row in conducted(
        plan, pool, "7 workers lost, repeated: run 1, run 2")}
    assert pool.given.count("run:1") == pool.given.count("run:2") == 4
    assert (rows[1]["status"], rows[1]["repeats"]) == ("done", 3)
    assert (rows[2]["status"], rows[3]["status"]) == ("worker_died", "done")
    assert rows[2]["message"] == "its worker died (4 times, last: SIGKILL)"


def test_without_a_reference_there_is_nothing_to_measure() -> None:
    plan = planned(HEAD + "grid: {bodies.a.mass: [1, 2]}\n")
    lost = f"reference:{plan.runs[0].reference}"

    def answer(name: str) -> dict[str, Any]:
        return {"status": "refused", "message": "no"} if name == lost else done(name)

    pool = Fake(answer)
    rows = sorted(conducted(plan, pool), key=lambda r: int(r["run"]))
    assert [(r["status"], r["message"]) for r in rows] == [
        ("refused", "reference: no"), ("done", "")]
    assert "run:1" not in pool.given


def test_progress_in_words() -> None:
    early = StudyProgress(216, 12, 1, 2, 200.0)
    assert in_words(early) == "12/216 done, 2 running, 1 failed, 3 min left"
    assert in_words(StudyProgress(6, 0, 0, 1, None)) == "0/6 done, 1 running, 0 failed"
    assert "0 failed, 2 workers lost, 9 s" in in_words(StudyProgress(6, 1, 0, 1, 9.0, 2))
    assert [duration(s) for s in (0.4, 99.0, 100.0, 5900.0, 6000.0)] == [
        "0 s", "99 s", "2 min", "98 min", "1.7 h"]


def test_no_column_stands_twice() -> None:
    for given_settings in ([], ["seed"], ["reducer", "how", "set.time.end"]):
        names = columns_of(given_settings, BODY_KINDS, late=True, over_time=True, keep=True)
        assert len(names) == len(set(names))
        assert set(names) >= RESERVED | {"reducer", "seed"}
    assert not {"late_elastic", "error_over_time"} & set(columns_of([], BODY_KINDS, late=False))
