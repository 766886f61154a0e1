"""Long studies, and studies through a real dask scheduler; processes are killed on the way."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sparsemor import study

DASK = Path(sys.executable).with_name("dask")
PROGRAM = Path(sys.executable).with_name("sparsemor")
SWING = Path(__file__).parents[1] / "scenes" / "swing.yaml"
FACTORIAL = Path(__file__).parents[1] / "benchmarks" / "studies" / "factorial.yaml"
TABLE = ("table.csv", "table.jsonl")

STUDY = f"""\
scene: {SWING}
set:
  time.end: 0.2
  training: {{end: 0.05}}
grid:
  reducer: [{{use: galerkin}}]
  reducer.basis.count: [3, 6]
  integrator: [bdf1, {{use: generalized_alpha, rho_inf: 0.5}}, {{use: generalized_alpha}}]
"""


@contextmanager
def cluster(folder: Path) -> Iterator[tuple[str, list["subprocess.Popen[bytes]"]]]:
    """Address of a scheduler with two workers of one thread each, and the workers."""
    told, log = folder / "scheduler.json", (folder / "dask.log").open("ab")
    started: list[subprocess.Popen[bytes]] = []

    def start(*arguments: str) -> "subprocess.Popen[bytes]":
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        started.append(subprocess.Popen([DASK, *arguments], stdout=log, stderr=log,
                                        env=environment, cwd=folder))
        return started[-1]

    try:
        start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
              "--scheduler-file", str(told))
        wait_for(lambda: told.exists() and told.stat().st_size > 0)
        address = json.loads(told.read_text())["address"]
        workers = [start("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
                   for _ in range(2)]
        yield address, workers
    finally:
        for process in started:
            process.kill()
            process.wait()
        log.close()


def wait_for(condition: object, seconds: float = 120.0) -> None:
    assert callable(condition)
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.01)


def committed(folder: Path) -> int:
    lines = folder / "runs.jsonl"
    return lines.read_bytes().count(b"\n") if lines.exists() else 0


@pytest.mark.slow
def test_a_cluster_makes_the_same_table_though_a_worker_dies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))
    Path("dozen.yaml").write_text(STUDY)
    study("dozen.yaml", out="whole", times=False)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache-of-cluster"))
    with cluster(tmp_path) as (address, workers):
        process = subprocess.Popen(
            [PROGRAM, "study", "dozen.yaml", "--scheduler", address, "--no-times", "--out", "far"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        wait_for(lambda: committed(Path("far")) >= 1 or process.poll() is not None)
        workers[0].kill()
        out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert "6 runs: 6 done" in out
    for file in TABLE:
        assert Path("far", file).read_bytes() == Path("whole", file).read_bytes()


@pytest.mark.slow
def test_the_factorial_is_one_table_killed_and_continued_and_on_a_cluster(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))
    asked = [PROGRAM, "study", FACTORIAL, "--no-times", "--quiet", "--out"]
    subprocess.run([*asked, "whole", "--workers", "2"], check=True)
    rows = [json.loads(line) for line in Path("whole/table.jsonl").read_text().splitlines()]
    assert [r["run"] for r in rows] == list(range(1, 109))
    assert {r["status"] for r in rows} == {"done"}
    found = [r for r in rows if r["basis"] == "pod" and r["reducer.solver"] != "omp"]
    assert len(found) == 24 and all(r["error_elastic"] < 1e-3 for r in found)

    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache-2"))
    process = subprocess.Popen([*asked, "killed", "--workers", "2"])
    wait_for(lambda: committed(Path("killed")) >= 50 or process.poll() is not None, 3000)
    process.kill()
    process.wait()
    assert 50 <= committed(Path("killed")) < 108
    subprocess.run([*asked, "killed", "--workers", "2"], check=True)

    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache-3"))
    with cluster(tmp_path) as (address, workers):
        process = subprocess.Popen([*asked, "far", "--scheduler", address])
        wait_for(lambda: committed(Path("far")) >= 20 or process.poll() is not None, 3000)
        workers[0].kill()
        assert process.wait(timeout=3600) == 0
    for other in ("killed", "far"):
        for file in TABLE:
            assert Path(other, file).read_bytes() == Path("whole", file).read_bytes()


@pytest.mark.slow
def test_no_cluster_no_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("dozen.yaml").write_text(STUDY)
    done = subprocess.run(
        [PROGRAM, "study", "dozen.yaml", "--scheduler", "tcp://127.0.0.1:9", "--out", "far"],
        capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines()[-1].startswith(
        "--scheduler: no scheduler responds at tcp://127.0.0.1:9")
    assert not Path("far").exists()
