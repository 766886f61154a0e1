"""Studies whose processes are killed or interrupted: one table all the same."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from sparsemor import study
from sparsemor.core.results.files.replaceable_files import own_files
from sparsemor.plugins.study.table_columns import TIMES
from swing_study import LETHAL, STUDY, SWING, command, rows_of


@pytest.fixture(autouse=True)
def six(here: Path) -> None:
    (here / "six.yaml").write_text(STUDY)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The folder of the same study, which nobody interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "six.yaml").write_text(STUDY)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPARSEMOR_CACHE", str(folder / "cache"))
        rows = study(folder / "six.yaml", out=folder / "out", times=False)
    assert [r["status"] for r in rows] == ["done", "not_converged"] * 3
    return str(folder / "out")


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


@pytest.mark.full
def test_killed_and_continued_with_workers(whole: str) -> None:
    process = started_and_committed(2, "six.yaml", "--workers", 2, "--no-times", "--out", "killed")
    workers = children(process.pid)
    assert workers
    process.kill()
    process.communicate(timeout=600)
    assert not Path("killed/table.csv").exists()
    for _ in range(1000):  # workers do not outlive their study
        if not any(alive(pid) for pid in workers):
            break
        time.sleep(0.01)
    assert not any(alive(pid) for pid in workers)
    # the killed process may have been writing; what it left is removed by the next one
    assert not [p for pid in workers for p in Path("killed").glob(f".sparsemor-tmp.*.{pid}.*")]
    with Path("killed/runs.jsonl").open("ab") as file:
        file.write(b'{"run":9,"sta')
    before = rows_of_whole_lines("killed")
    study("six.yaml", workers=2, out="killed", times=False)
    assert same("killed", whole)
    assert rows_of("killed", "runs.jsonl")[:len(before)] == before
    assert not own_files(Path("killed")).changed
    assert not list(Path("killed").glob(".sparsemor-tmp.*"))


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


@pytest.mark.slow
def test_ctrl_c_leaves_a_table_that_can_be_continued(whole: str) -> None:
    process = started_and_committed(1, "six.yaml", "--workers", 1, "--no-times", "--out", "cut")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=600)
    assert process.returncode == 130
    assert "not run yet" in out
    assert "interrupted: the same command continues" in err.splitlines()[-1]
    assert 1 <= len(rows_of("cut", "runs.jsonl")) < 6
    study("six.yaml", out="cut", times=False)
    assert same("cut", whole)


@pytest.mark.slow
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
  - {{use: lethal, mark: none, times: 0}}
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
    assert "none to kill" in rows[3]["message"]
    assert rows[1]["error_elastic"] == rows[0]["error_elastic"]
