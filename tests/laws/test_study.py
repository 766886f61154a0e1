"""What a study does whatever its scene: runs in order, rows that are whole, dead workers."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sparsemor.core.errors import InputError
from sparsemor.core.plain import finite
from sparsemor.core.study.columns import RESERVED, TIMES, cell, columns_of
from sparsemor.core.study.journal import Journal, alone
from sparsemor.core.study.plan import Plan
from sparsemor.core.study.pools import Ended
from sparsemor.core.study.progress import duration, in_words
from sparsemor.core.study.schedule import Row, Schedule, State
from toy_scene import TOY_SCENE

HEAD = "scene: scene.yaml\nreference: {reducer: direct}\n"
GRID = HEAD + """\
grid:
  reducer.sampler.mix: [0.1, 0.2]
  bodies.a.mass: [1, 2, 3]
  how:
    few: {reducer.budgets: {a: 1}}
    many: {reducer.budgets: {a: 9}, integrator.rho: 0.5}
seeds: [7, 4]
"""

pytestmark = pytest.mark.usefixtures("toys")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(TOY_SCENE)


def planned(text: str) -> Plan:
    Path("study.yaml").write_text(text)
    return Plan.of("study.yaml")


def test_a_grid_is_every_combination_in_order() -> None:
    plan = planned(GRID)
    assert [run.number for run in plan.runs] == list(range(1, 25))
    assert plan.settings == (
        "reducer.sampler.mix", "bodies.a.mass", "how", "set.reducer.budgets", "set.integrator.rho",
        "seed")
    keys = ("reducer.sampler.mix", "bodies.a.mass", "how", "seed")
    points = [tuple(run.settings[k] for k in keys) for run in plan.runs]
    assert points == [(mix, mass, how, seed) for mix in (0.1, 0.2) for mass in (1, 2, 3)
                      for how in ("few", "many") for seed in (7, 4)]
    first, last = plan.runs[0], plan.runs[-1]
    assert first.scene is not None and last.scene is not None
    assert first.scene.tree["reducer"]["sampler"]["mix"] == 0.1
    assert last.scene.tree["reducer"]["budgets"] == {"a": 9}
    assert (last.scene.tree["integrator"]["rho"], last.scene.tree["seed"]) == (0.5, 4)
    assert "integrator.rho" not in first.settings


def test_runs_share_a_reference_when_their_physics_integrator_and_step_are_the_same() -> None:
    plan = planned(GRID)
    assert len(plan.references) == 3 * 2  # masses, and the integrator of `many`
    for run in plan.runs:
        tree = plan.references[run.reference].tree
        assert tree["reducer"] == "direct"
        assert tree["bodies"]["a"]["mass"] == run.settings["bodies.a.mass"]
        assert "seed" not in tree
    assert len(planned(GRID.replace("{reducer: direct}", "{fixed: {reducer: direct}}")
                       ).references) == 1


def test_a_random_subset_repeats_nothing_and_knows_its_seed() -> None:
    axes = "{bodies.a.mass: [1, 2, 3, 4, 5], seed: [1, 2, 3, 4, 5]}"
    chosen = []
    for seed in (1, 1, 2):
        plan = planned(HEAD + f"random: {{count: 12, seed: {seed}, axes: {axes}}}\n")
        chosen.append([tuple(run.settings.values()) for run in plan.runs])
    assert chosen[0] == chosen[1] != chosen[2]
    assert all(len(set(points)) == 12 and points == sorted(points) for points in chosen)


def test_a_list_is_one_run_an_item() -> None:
    plan = planned(HEAD + "list:\n- {label: heavy, bodies.a.mass: 9}\n- {seed: 3}\n- {}\n")
    assert [dict(run.settings) for run in plan.runs] == [
        {"label": "heavy", "bodies.a.mass": 9}, {"seed": 3}, {}]
    assert plan.settings == ("label", "bodies.a.mass", "seed")
    assert plan.lines == ("label",)


def test_a_combination_that_only_some_values_refuse_is_a_refused_run() -> None:
    plan = planned(HEAD + "grid:\n  reducer.sampler: [grid, dice]\n"
                   "  reducer.sampler.mix: [0.5, 0.7]\n")
    assert [bool(run.refused) for run in plan.runs] == [False, False, True, True]
    assert "reducer.sampler.mix: no such option" in plan.runs[2].refused


@pytest.mark.parametrize("text, expected", [
    ("", "the file is empty: a study is a mapping"),
    ("grid: {seed: [1]}\n", "study.yaml:1:1: scene: is missing"),
    ("scene: nowhere.yaml\ngrid: {seed: [1]}\n", "study.yaml:1:1: scene: there is no such file"),
    (HEAD, "study.yaml:1:1: a study has exactly one of grid, list, random (given: none)"),
    (HEAD + "grid: {seed: [1]}\nlist: [{}]\n", "study.yaml:4:1: list: a study has exactly one of"),
    (HEAD + "gird: {seed: [1]}\n", "study.yaml:3:1: gird: no such option: did you mean grid"),
    (HEAD + "set: {time.stop: 1}\ngrid: {seed: [1]}\n",
     "study.yaml:3:7: set.time.stop: no such option"),
    (HEAD + "set: [1]\ngrid: {seed: [1]}\n", "study.yaml:3:1: set: Input should be keys with"),
    (HEAD + "grid: {}\n", "study.yaml:3:1: grid: Dictionary should have at least 1 item"),
    (HEAD + "grid:\n  bodies.a.mass: []\n", "study.yaml:4:3: grid.bodies.a.mass: an axis is a"),
    (HEAD + "grid:\n  bodies.a.mass: 3\n", "study.yaml:4:3: grid.bodies.a.mass: an axis is a"),
    (HEAD + "grid:\n  bodies.a.mass: [1, -1]\n",
     "study.yaml:4:22: grid.bodies.a.mass.1: bodies.a.mass: Input should be greater than 0"),
    (HEAD + "grid:\n  bodies.a.mass: [1, 2, 1]\n",
     "study.yaml:4:25: grid.bodies.a.mass.2: the same as item 0: remove one"),
    (HEAD + "grid:\n  how:\n    a: {seed: 1}\n    b: {reducer: tund}\n",
     "study.yaml:6:9: grid.how.b.reducer: no reducer plugin is called 'tund': did you mean tuned"),
    (HEAD + "grid:\n  how: {a: 3}\n", "study.yaml:4:9: grid.how.a: an alternative is a mapping"),
    (HEAD + "grid:\n  status: {a: {seed: 1}}\n", "study.yaml:4:3: grid.status: status is a column"),
    (HEAD + "grid:\n  seed: [1]\n  how: {a: {seed: 1}}\n",
     "study.yaml:5:3: grid.how: seed is also changed by the axis seed"),
    (HEAD + "list:\n- {seed: 1}\n- {seed: -1}\n",
     "study.yaml:5:4: list.1.seed: Input should be greater than or equal to 0 (given: -1)"),
    (HEAD + "list:\n- {seed: 1, label: [x]}\n", "study.yaml:4:13: list.0.label: a label is a text"),
    (HEAD + "random: {count: 3, axes: {seed: [1, 2]}}\n",
     "study.yaml:3:10: random.count: the axes have 2 combinations"),
    (HEAD + "random: {count: 0, axes: {seed: [1, 2]}}\n", "study.yaml:3:10: random.count: Input"),
    (HEAD + "seeds: [1, 1]\nlist: [{}]\n", "study.yaml:3:12: seeds.1: the same as item 0"),
    (HEAD + "seeds: [-1]\nlist: [{}]\n", "study.yaml:3:9: seeds.0: a seed is at least 0"),
    (HEAD + "seeds: [1]\ngrid: {seed: [1]}\n", "study.yaml:3:1: seeds: the seed is also changed"),
    (HEAD + "budget: mass\ngrid: {seed: [1]}\n", "study.yaml:3:1: budget: nothing of that name"),
    (HEAD + "method: [seed, x]\ngrid: {seed: [1]}\n", "study.yaml:3:16: method.1: nothing of that"),
    (HEAD + "errors_from: -1\ngrid: {seed: [1]}\n", "study.yaml:3:1: errors_from: Input should be"),
    ("scene: scene.yaml\nreference: {reducer: fulll}\ngrid: {seed: [1, 2]}\n",
     "study.yaml:2:13: reference.reducer: no reducer plugin is called 'fulll'"),
    ("scene: scene.yaml\nreference: {fixed: 1}\ngrid: {seed: [1, 2]}\n",
     "study.yaml:2:13: reference.fixed: give changes to the scene"),
    ("scene: scene.yaml\nreference: {fixed: {}, seed: 1}\ngrid: {seed: [1, 2]}\n",
     "study.yaml:2:24: reference.seed: move it under `fixed`"),
])
def test_faults_have_their_place(text: str, expected: str) -> None:
    with pytest.raises(InputError) as caught:
        planned(text)
    assert expected in str(caught.value)
    assert sorted(p.name for p in Path().iterdir() if p.suffix == ".yaml") == [
        "scene.yaml", "study.yaml"]


def test_faults_of_the_scene_are_told_where_they_are() -> None:
    Path("scene.yaml").write_text(TOY_SCENE.replace("mass: 1", "mass: -1"))
    with pytest.raises(InputError) as caught:
        planned(HEAD + "grid: {seed: [1, 2]}\n")
    assert str(caught.value).splitlines() == [
        "scene.yaml:3:18: bodies.a.mass: Input should be greater than 0 (given: -1)"]


def row_of(run: int, **values: Any) -> Row:
    return {"run": run, "status": "done", "message": "", "facts": {}, **values}


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner,
                                                                 max_size=3), max_leaves=6)


@settings(max_examples=12, deadline=None)
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


def test_the_folder_of_another_study_is_refused() -> None:
    plan = planned(HEAD + "grid: {seed: [1, 2]}\n")
    Journal.open(Path("out"), plan)
    with alone(Path("out")), pytest.raises(InputError, match="another process is at work"):
        with alone(Path("out")):
            pass
    Journal.open(Path("out"), planned("# a comment\n" + HEAD + "grid: {seed: [1, 2]}\n"))
    for changed in (HEAD + "grid: {seed: [1, 3]}\n", HEAD + "grid: {seed: [2, 1]}\n"):
        with pytest.raises(InputError, match="holds another study"):
            Journal.open(Path("out"), planned(changed))
    Path("scene.yaml").write_text(TOY_SCENE.replace("mass: 1", "mass: 2"))
    with pytest.raises(InputError, match="holds another study"):
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

    workers, repeats = 2, 3

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

    def next(self, timeout: float) -> Ended:
        name = self.flying.pop()
        return Ended(name, self.answer(name), "SIGKILL")

    def close(self) -> None:
        pass


def conducted(plan: Plan, pool: Fake) -> list[Row]:
    rows: list[Row] = []
    states: list[State] = []
    Schedule(plan, plan.runs, pool, (), None).go(
        rows.append, lambda state, row: states.append(state))
    assert states[-1].done == len(plan.runs) == len(rows) == len({r["run"] for r in rows})
    assert states[-1].failed == sum(r["status"] != "done" for r in rows)
    assert not pool.flying
    return rows


def done(name: str) -> dict[str, Any]:
    return {"status": "done", "message": "", "key": "k"}


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
    rows = {row["run"]: row for row in conducted(plan, pool)}
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
    assert in_words(State(216, 12, 1, 2, 200.0)) == "12/216 done, 2 running, 1 failed, 3 min left"
    assert in_words(State(6, 0, 0, 1, None)) == "0/6 done, 1 running, 0 failed"
    assert [duration(s) for s in (0.4, 99.0, 100.0, 5900.0, 6000.0)] == [
        "0 s", "99 s", "2 min", "98 min", "1.7 h"]


def test_no_column_stands_twice() -> None:
    for given_settings in ([], ["seed"], ["reducer", "how", "set.time.end"]):
        names = columns_of(given_settings, late=True, over_time=True)
        assert len(names) == len(set(names))
        assert set(names) >= RESERVED | {"reducer", "seed"}
    assert not {"late_elastic", "error_over_time"} & set(columns_of([], late=False))
