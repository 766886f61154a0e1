"""Studies on a real scene: one table whatever happens to the processes that make it."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from sparsemor import InputError, study
from sparsemor.core.study import conduct
from sparsemor.core.study.columns import TIMES
from sparsemor.core.study.plan import Plan

HERE = Path(__file__).parent
SWING = HERE / "scenes" / "swing.yaml"
PROGRAM = Path(sys.executable).with_name("sparsemor")

STUDY = f"""\
title: How many columns, and what goes wrong
scene: {SWING}
set:
  time.end: 0.05
  training: {{end: 0.05}}
  reducer: {{use: galerkin, basis: {{use: pod, count: 6}}}}
grid:
  reducer.basis.count: [2, 4, 6]
  method:
    plain: {{}}
    hurried: {{reducer.max_iterations: 1, reducer.remaining: 1.0e-15}}
budget: reducer.basis.count
errors_from: 0.02
over_time: true
"""

LETHAL = '''
"""A preconditioner that kills its process a given number of times."""

import os
import signal
from pathlib import Path

import numpy as np

from sparsemor.core.plugin import Plugin


class Lethal(Plugin):
    """Kills."""

    mark: str
    """Where it counts."""
    times: int
    """How often."""

    def check(self, rows, atoms):
        return ""

    def build(self, A):
        with open(self.mark, "a") as file:
            file.write("x")
        if Path(self.mark).stat().st_size <= self.times:
            os.kill(os.getpid(), signal.SIGKILL)
        return np.eye(len(A))
'''


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))
    Path("six.yaml").write_text(STUDY)


def command(*arguments: object) -> list[str]:
    return [str(PROGRAM), "study", *map(str, arguments)]


def ran(*arguments: object, code: int = 0) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(command(*arguments), capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def rows_of(folder: str, file: str = "table.jsonl") -> list[dict[str, Any]]:
    return [json.loads(line) for line in Path(folder, file).read_text().splitlines()]


def same(a: str, b: str) -> bool:
    """Whether two tables without times have the same bytes, which hold no time."""
    assert not set(rows_of(a)[0]) & set(TIMES)
    return all(Path(a, f).read_bytes() == Path(b, f).read_bytes()
               for f in ("table.csv", "table.jsonl"))


def started_and_committed(count: int, *arguments: object) -> "subprocess.Popen[str]":
    """The program in a process of its own, as soon as `count` runs are in its table."""
    process = subprocess.Popen(command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               text=True)
    lines = Path(str(arguments[-1]), "runs.jsonl")
    for _ in range(12000):
        if process.poll() is not None or (
                lines.exists() and lines.read_bytes().count(b"\n") >= count):
            break
        time.sleep(0.005)
    assert process.poll() is None, process.communicate()
    return process


def test_a_run_that_cannot_be_prepared_is_not_the_failure_of_its_neighbours() -> None:
    """All share training run and basis, which the first of them is prepared to make."""
    budgets = {"*.elastic": {"rows": 40, "atoms": 4}, "*.thermal": {"rows": 20, "atoms": 3}}
    twins = {"use": "dictionary", "bases": ["pod", {"use": "modal", "count": 60}]}
    Path("two.yaml").write_text(json.dumps({
        "scene": str(SWING), "set": {"time.end": 0.01, "training": {"end": 0.05}},
        "list": [{"reducer": {"use": "galerkin", "basis": twins}},
                 {"reducer": {"use": "sparse", "basis": twins, "budgets": budgets}}]}))
    rows = study("two.yaml", out="two")
    assert [r["status"] for r in rows] == ["rank_deficient", "done"]
    assert "depend on each other" in rows[0]["message"] and rows[1]["steps"] == 10


def test_one_table_also_of_runs_that_fail() -> None:
    done = ran("six.yaml", "--out", "a")
    for said in ("6 runs: 3 done, 3 not_converged", "work_precision.png", "table.csv",
                 "error_over_time.png"):
        assert said in done.stdout
    assert done.stderr.splitlines()[-1].endswith("6/6 done, 0 running, 3 failed, 0 s left")
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
        assert "did not contract" in r["message"]
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
        "study.json", "runs.csv", "runs.jsonl", "runs.parquet", "table.csv", "table.jsonl",
        "work_precision.png", "work_precision.svg", "error_over_time.png", "error_over_time.svg"}
    assert study("six.yaml", out="a") == [
        {k: v for k, v in r.items() if not k.startswith("fact.")} for r in rows]


def test_killed_and_continued_with_workers() -> None:
    whole = study("six.yaml", out="whole", times=False)
    assert [r["status"] for r in whole] == ["done", "not_converged"] * 3
    process = started_and_committed(2, "six.yaml", "--workers", 2, "--no-times", "--out", "killed")
    workers = children(process.pid)
    assert workers
    process.kill()
    process.communicate(timeout=60)
    assert not Path("killed/table.csv").exists()
    for _ in range(1000):  # workers do not outlive their study
        if not any(alive(pid) for pid in workers):
            break
        time.sleep(0.01)
    assert not any(alive(pid) for pid in workers)
    with Path("killed/runs.jsonl").open("ab") as file:
        file.write(b'{"run":9,"sta')
    before = rows_of_whole_lines("killed")
    study("six.yaml", workers=2, out="killed", times=False)
    assert same("killed", "whole")
    assert rows_of("killed", "runs.jsonl")[:len(before)] == before
    assert not Path("killed/.scratch").exists()


def rows_of_whole_lines(folder: str) -> list[dict[str, Any]]:
    text = Path(folder, "runs.jsonl").read_bytes()
    return [json.loads(line) for line in text.splitlines(keepends=True) if line.endswith(b"\n")]


def children(pid: int) -> list[int]:
    return [int(p) for p in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_ctrl_c_leaves_a_table_that_can_be_continued() -> None:
    process = started_and_committed(1, "six.yaml", "--workers", 1, "--no-times", "--out", "cut")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "not run yet" in out
    assert "interrupted: the same command goes on from" in err.splitlines()[-1]
    assert 1 <= len(rows_of("cut", "runs.jsonl")) < 6
    study("six.yaml", out="cut", times=False)
    study("six.yaml", out="whole", times=False)
    assert same("cut", "whole")


def test_a_worker_that_dies_is_replaced(tmp_path: Path, distribute: Any) -> None:
    distribute("lethal-pkg", {"preconditioner": {"lethal": "lethal_plugin:Lethal"}},
               lethal_plugin=LETHAL)
    marks = {name: str(tmp_path / name) for name in ("once", "ever")}
    Path("deadly.yaml").write_text(f"""\
scene: {SWING}
set: {{time.end: 0.01, training: {{end: 0.01}}}}
grid:
  reducer.preconditioner:
  - none
  - {{use: lethal, mark: {marks["once"]}, times: 1}}
  - {{use: lethal, mark: {marks["ever"]}, times: 99}}
  - untf
""")
    site = tmp_path / "site-lethal-pkg"
    environment = os.environ | {"PYTHONPATH": str(site)}
    done = subprocess.run(command("deadly.yaml", "--workers", 2, "--json", "--out", "d"),
                          check=True, env=environment, capture_output=True, text=True)
    rows = json.loads(done.stdout)["runs"]
    assert [(r["status"], r["repeats"]) for r in rows] == [
        ("done", 0), ("done", 1), ("worker_died", 4), ("refused", 0)]
    assert rows[2]["message"] == "its worker died (4 times, last: SIGKILL)"
    assert Path(marks["ever"]).read_text() == "xxxx"
    assert "UNTF needs at least as many atoms as rows" in rows[3]["message"]
    assert rows[1]["error_elastic"] == rows[0]["error_elastic"]


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
    assert bad.stderr == (
        "six.yaml:8:31: grid.reducer.basis.count.2: reducer.basis.count: Input should be greater "
        "than or equal to 1 (given: -6)\n")
    shown = json.loads(ran("nowhere", "--json", code=2).stdout)
    assert shown["errors"][0].startswith("no packaged study, and no file, is called 'nowhere'")
    Path("six.yaml").write_text(STUDY)
    assert "--workers: at least 0" in ran("six.yaml", "--workers", -1, code=2).stderr
    with pytest.raises(InputError, match="there is no such file"):
        study("no.yaml")
    with pytest.raises(InputError, match="either --workers or --scheduler"):
        study("six.yaml", workers=2, scheduler="tcp://127.0.0.1:9")
    assert sorted(Path().rglob("*")) == before


def test_force_begins_anew_and_replaces_studies_only() -> None:
    Path("one.yaml").write_text(STUDY.replace("[2, 4, 6]", "[2]"))
    study("one.yaml", out="a")
    Path("one.yaml").write_text(STUDY.replace("[2, 4, 6]", "[4]"))
    assert "--out: " in ran("one.yaml", "--out", "a", code=2).stderr
    plan = Plan.of("one.yaml")
    conduct(plan, out="a", force=True)
    assert [r["reducer.basis.count"] for r in rows_of("a")] == [4, 4]
    Path("mine").mkdir()
    Path("mine/thesis.tex").touch()
    with pytest.raises(InputError, match="no study"):
        conduct(plan, out="mine", force=True)
    assert Path("mine/thesis.tex").exists()


def test_a_packaged_study_is_found_by_its_name(distribute: Any, tmp_path: Path) -> None:
    packaged = tmp_path / "site-studies" / "mine.yaml"
    distribute("studies", {"study": {"mine": "study_paths:mine"}}, study_paths=(
        f"from pathlib import Path\nmine = Path({str(packaged)!r})\n"))
    packaged.write_text(STUDY.replace("[2, 4, 6]", "[2]"))
    rows = study("mine")
    assert [r["status"] for r in rows] == ["done", "not_converged"]
    assert Path("runs/mine/table.csv").exists()
    listed = subprocess.run(
        [PROGRAM, "plugins", "study", "--json"], capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONPATH": str(packaged.parent)})
    shown = [p for p in json.loads(listed.stdout)["plugins"] if p["name"] == "mine"]
    assert shown[0]["doc"] == "How many columns, and what goes wrong"
