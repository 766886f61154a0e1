"""Studies on a real scene: what the table says, also of runs that fail, and what is refused."""

import contextvars
import csv
import json
import os
from pathlib import Path
from typing import Any

import pytest

from in_process import Done, sparsemor
from sparsemor import InputError, study
from sparsemor.core.results.output_lock import LOCK
from sparsemor.plugins.study import run_plan
from sparsemor.plugins.study.plan import StudyPlan
from swing_study import STUDY, SWING, rows_of

pytestmark = pytest.mark.full


@pytest.fixture(autouse=True)
def six(here: Path) -> None:
    (here / "six.yaml").write_text(STUDY)


def ran(*arguments: object, code: int = 0) -> Done:
    return sparsemor("study", *arguments, code=code)


def test_a_run_that_cannot_be_prepared_is_not_the_failure_of_its_neighbours() -> None:
    """All share training run and basis, which the first of them is prepared to make."""
    budgets = {"*.elastic": {"rows": 40, "atoms": 4}, "*.thermal": {"rows": 20, "atoms": 3}}
    few = {"*.elastic": {"rows": 4}}
    twins = {"use": "dictionary", "bases": ["pod", {"use": "modal", "count": 60}]}
    Path("two.yaml").write_text(json.dumps({
        "scene": str(SWING), "set": {"time.end": 0.01, "training": {"end": 0.05}},
        "list": [{"reducer": {"use": "sparse", "basis": twins, "budgets": few}},
                 {"reducer": {"use": "sparse", "basis": twins, "budgets": budgets}}]}))
    rows = study("two.yaml", out="two")
    assert [r["status"] for r in rows] == ["refused", "done"]
    assert "active atoms" in rows[0]["message"] and rows[1]["steps"] == 10


def test_one_table_also_of_runs_that_fail() -> None:
    done = ran("six.yaml", "--out", "a")
    for said in ("6 runs: 3 done, 3 not_converged", "work_precision.png", "table.csv",
                 "error_over_time.png"):
        assert said in done.out
    assert done.lines[-1].endswith("6/6 done, 0 running, 3 failed, 0 s left")
    rows = rows_of("a")
    assert [r["run"] for r in rows] == [1, 2, 3, 4, 5, 6]
    plain, hurried = rows[::2], rows[1::2]
    assert [r["atoms_all"] for r in plain] == [4, 8, 11]
    errors = [r["error_elastic"] for r in plain]
    assert errors[0] > 10 * errors[1] > 100 * errors[2] > 0
    for r in plain:
        assert (r["status"], r["reference_status"], r["steps"], r["message"]) == (
            "done", "done", 50, "")
        assert 0 < r["late_elastic"] <= r["error_elastic"]
        assert r["error_elastic"] == max(r["start_up_elastic"], r["steady_elastic"])
        seen = r["error_over_time"]
        assert seen["time"][0] == pytest.approx(1e-3) and seen["time"][-1] == pytest.approx(0.05)
        assert max(seen["elastic"]) == pytest.approx(r["error_elastic"], rel=1e-3)
        assert r["speed_up"] == pytest.approx(r["reference_ms_per_step"] / r["ms_per_step"])
        assert r["offline_total_s"] > r["offline_s"] > 0  # training was found in the cache
        assert (r["workers"], r["repeats"]) == (0, 0)
    for r in hurried:
        assert r["status"] == "not_converged"
        assert "did not converge" in r["message"]
        assert (r["steps"], r["error_elastic"], r["pays_after"]) == (0, None, None)
    with Path("a/table.csv").open(newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert [float(t["error_elastic"] or "nan") for t in table] == pytest.approx(
        [r["error_elastic"] or float("nan") for r in rows], rel=0, abs=0, nan_ok=True)
    from pyarrow import parquet

    columns = parquet.read_table("a/runs.parquet").to_pydict()
    assert list(columns) == list(rows[0])
    assert columns["error_elastic"] == [r["error_elastic"] for r in rows]
    assert columns["status"] == [r["status"] for r in rows]
    assert {p.name for p in Path("a").iterdir()} == {
        ".sparsemor.jsonl", "study.json", "runs.csv", "runs.jsonl", "runs.parquet", "table.csv",
        "table.jsonl",
        "work_precision.png", "work_precision.svg", "error_over_time.png", "error_over_time.svg"}
    assert study("six.yaml", out="a") == [
        {k: v for k, v in r.items() if not k.startswith("fact.")} for r in rows]


@pytest.mark.slow
def test_a_full_order_run_is_its_own_reference_and_the_others_share_it() -> None:
    Path("shared.yaml").write_text(f"""\
scene: {SWING}
set: {{time.end: 0.02, training: {{end: 0.02}}}}
grid: {{reducer: [full, {{use: galerkin}}], time.step: [1.0e-3, 2.0e-3]}}
seeds: [1, 2]
""")
    rows = study("shared.yaml", out="each")
    assert [r["reducer"] for r in rows] == ["full"] * 4 + [{"use": "galerkin"}] * 4
    for r in rows[:4]:
        assert (r["error_elastic"], r["speed_up"]) == (0.0, 1.0)
    kept = list(Path(os.environ["SPARSEMOR_CACHE"], "reference").iterdir())
    assert len(kept) == 2  # one a step length, whatever the seed
    fixed = Path("shared.yaml").read_text() + "reference: fixed\n"
    Path("fixed.yaml").write_text(fixed)
    one = study("fixed.yaml", out="one")
    assert one[0]["error_elastic"] == 0.0 < one[2]["error_elastic"]
    assert len(list(Path(os.environ["SPARSEMOR_CACHE"], "reference").iterdir())) == 2


def test_bad_input_writes_nothing() -> None:
    before = sorted(Path().rglob("*"))
    Path("six.yaml").write_text(STUDY.replace("count: [2, 4, 6]", "count: [2, 4, -6]"))
    bad = ran("six.yaml", "--out", "a", code=2)
    assert bad.err == (
        "six.yaml:8:31: grid.reducer.basis.count.2: reducer.basis.count: Input should be greater "
        "than or equal to 1 (got -6)\n")
    shown = json.loads(ran("nowhere", "--json", code=2).out)
    assert shown["errors"][0].startswith("no packaged study, and no file, is called 'nowhere'")
    Path("six.yaml").write_text(STUDY)
    assert "--workers: at least 0" in ran("six.yaml", "--workers", -1, code=2).err
    with pytest.raises(InputError, match="there is no such file"):
        study("no.yaml")
    with pytest.raises(InputError, match="either --workers or --scheduler"):
        study("six.yaml", workers=2, scheduler="tcp://127.0.0.1:9")
    assert sorted(Path().rglob("*")) == before


def test_force_begins_anew_and_replaces_studies_only() -> None:
    Path("one.yaml").write_text(STUDY.replace("[2, 4, 6]", "[2]"))
    study("one.yaml", out="a")
    Path("one.yaml").write_text(STUDY.replace("[2, 4, 6]", "[4]"))
    assert "--out: " in ran("one.yaml", "--out", "a", code=2).err
    plan = StudyPlan.read("one.yaml")
    run_plan(plan, out="a", force=True)
    assert [r["reducer.basis.count"] for r in rows_of("a")] == [4, 4]
    assert not {".replaced", LOCK} & {p.name for p in Path("a").iterdir()}
    Path("mine").mkdir()
    Path("mine/thesis.tex").touch()
    with pytest.raises(InputError, match="no study"):
        run_plan(plan, out="mine", force=True)
    assert Path("mine/thesis.tex").exists()


def test_force_keeps_the_earlier_table_until_the_new_one_stands() -> None:
    Path("one.yaml").write_text(STUDY.replace("[2, 4, 6]", "[2]"))
    earlier = study("one.yaml", out="a")
    Path("one.yaml").write_text(STUDY.replace("[2, 4, 6]", "[4]"))

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_plan(StudyPlan.read("one.yaml"), out="a", force=True, on_progress=interrupt)
    assert [r["run"] for r in rows_of("a/.replaced")] == [r["run"] for r in earlier]
    run_plan(StudyPlan.read("one.yaml"), out="a")
    assert [r["reducer.basis.count"] for r in rows_of("a")] == [4, 4]
    assert not Path("a/.replaced").exists()


def test_one_study_at_a_time_in_a_folder() -> None:
    Path("one.yaml").write_text(STUDY.replace("[2, 4, 6]", "[2]"))
    found: list[str] = []

    def second(*_: object) -> None:
        with pytest.raises(InputError, match="another run is writing to") as error:
            contextvars.Context().run(run_plan, StudyPlan.read("one.yaml"), out="a", force=True)
        found.append(str(error.value))

    run_plan(StudyPlan.read("one.yaml"), out="a", on_progress=second)
    assert found and [r["reducer.basis.count"] for r in rows_of("a")] == [2, 2]


def test_a_damaged_reference_in_the_cache_is_made_again(
    caplog: pytest.LogCaptureFixture
) -> None:
    Path("one.yaml").write_text(STUDY.replace("[2, 4, 6]", "[2]"))
    study("one.yaml", out="a", times=False)
    (store,) = Path(os.environ["SPARSEMOR_CACHE"]).glob("reference/*/result")
    damaged = store / "steps-000000.npz"
    damaged.write_bytes(damaged.read_bytes()[:-1] + b"?")
    study("one.yaml", out="b", times=False)
    assert Path("a/table.csv").read_bytes() == Path("b/table.csv").read_bytes()
    assert "made again" in caplog.text and str(damaged) in caplog.text


def test_a_packaged_study_is_found_by_its_name(distribute: Any, tmp_path: Path) -> None:
    packaged = tmp_path / "site-studies" / "mine.yaml"
    distribute("studies", {"study": {"mine": "study_paths:mine"}}, study_paths=(
        f"from pathlib import Path\nmine = Path({str(packaged)!r})\n"))
    packaged.write_text(STUDY.replace("[2, 4, 6]", "[2]"))
    rows = study("mine")
    assert [r["status"] for r in rows] == ["done", "not_converged"]
    assert Path("runs/mine/table.csv").exists()
    listed = json.loads(sparsemor("plugins", "study", "--json", code=0).out)["plugins"]
    shown = [p for p in listed if p["name"] == "mine"]
    assert shown[0]["doc"] == "How many columns, and what goes wrong"
