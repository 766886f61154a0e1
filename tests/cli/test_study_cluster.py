"""Long studies, and studies through a real dask scheduler; processes are killed on the way."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from sparsemor import InputError, study
from swing_study import LETHAL, PROGRAM, SWING, command, rows_of

DASK = Path(sys.executable).with_name("dask")
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
def cluster(
    folder: Path, count: int = 2
) -> Iterator[tuple[str, list["subprocess.Popen[bytes]"]]]:
    """Address of a scheduler with workers of one thread each, and the workers."""
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
                   for _ in range(count)]
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


def same(a: str, b: str) -> bool:
    return all(Path(a, file).read_bytes() == Path(b, file).read_bytes() for file in TABLE)


@pytest.mark.slow
def test_a_cluster_is_given_as_object_client_address_or_file(here: Path) -> None:
    distributed = pytest.importorskip("distributed")
    Path("six.yaml").write_text(STUDY.replace("time.end: 0.2", "time.end: 0.05"))
    whole = study("six.yaml", out="whole", times=False)
    assert {row["status"] for row in whole} == {"done"}
    with distributed.LocalCluster(
            n_workers=2, threads_per_worker=2, dashboard_address=None, host="127.0.0.1") as local:
        with distributed.Client(local) as client:
            client.write_scheduler_file("scheduler.json")
            forms = {"object": local, "client": client, "address": local.scheduler_address,
                     "file": Path("scheduler.json"), "name": "scheduler.json"}
            for name, form in forms.items():
                rows = study("six.yaml", out=name, scheduler=form)
                assert {row["workers"] for row in rows} == {2}
                study("six.yaml", out=name, scheduler=form, times=False)
                assert same(name, "whole"), name
            assert client.submit(len, "open").result() == 4
        with pytest.raises(InputError, match="no scheduler responds.*the client is closed"):
            study("six.yaml", out="closed", scheduler=client)
    with pytest.raises(InputError, match="no scheduler responds"):
        study("six.yaml", out="closed", scheduler=local)


@pytest.mark.slow
def test_a_cluster_makes_the_same_table_though_workers_die(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))
    Path("dozen.yaml").write_text(STUDY)
    study("dozen.yaml", out="whole", times=False)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache-of-cluster"))
    with cluster(tmp_path, 4) as (_, workers):
        process = subprocess.Popen(
            [PROGRAM, "study", "dozen.yaml", "--scheduler-file", "scheduler.json", "--no-times",
             "--out", "far"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        wait_for(lambda: committed(Path("far")) >= 1 or process.poll() is not None)
        for worker in workers[:2]:
            worker.kill()
        out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert "6 runs: 6 done" in out and "2 workers lost" in out
    assert same("far", "whole")


@pytest.mark.slow
def test_a_run_that_kills_its_workers_is_given_up(
    here: Path, distribute: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    distribute("lethal-pkg", {"preconditioner": {"lethal": "lethal_plugin:Lethal"}},
               lethal_plugin=LETHAL)
    monkeypatch.setenv("PYTHONPATH", str(here.parent / "site-lethal-pkg"))
    marks = {name: str(here / name) for name in ("once", "ever")}
    Path("deadly.yaml").write_text(f"""\
scene: {SWING}
reference: none
set: {{time.end: 0.01, training: {{end: 0.01}}}}
list:
- {{reducer.preconditioner: none}}
- {{reducer.preconditioner: {{use: lethal, mark: {marks["once"]}, times: 1}}}}
- {{reducer.preconditioner: {{use: lethal, mark: {marks["ever"]}, times: 99}}}}
""")
    with cluster(here, 6) as (address, _):
        done = subprocess.run(command("deadly.yaml", "--scheduler", address, "--out", "d"),
                              capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    rows = rows_of("d")
    assert [(r["status"], r["repeats"]) for r in rows] == [
        ("done", 0), ("done", 1), ("worker_died", 4)]
    assert rows[2]["message"].startswith("its worker died (4 times, last: worker tcp://127.0.0.1:")
    assert Path(marks["ever"]).read_text() == "xxxx"
    assert done.stdout.splitlines()[-2] == "5 workers lost, repeated: run 2, run 3"


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
    assert same("killed", "whole") and same("far", "whole")


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


@pytest.mark.full
def test_what_is_no_cluster_is_refused(here: Path) -> None:
    pytest.importorskip("distributed")
    Path("dozen.yaml").write_text(STUDY)
    Path("other.json").write_text("[1]")
    for given, said in (
            ("nowhere.json", "nowhere.json is neither an address (tcp://host:port) nor a"),
            ("other.json", "other.json is not a scheduler file of dask"),
            ("tcp://host", "no scheduler responds at tcp://host (an address is tcp://host:port)"),
            (5, "no scheduler responds at 5 (Scheduler address must be a string")):
        with pytest.raises(InputError) as refused:
            study("dozen.yaml", out="far", scheduler=given)
        assert f"scheduler: {said}" in str(refused.value)
    done = subprocess.run(
        command("dozen.yaml", "--scheduler", "host:1", "--scheduler-file", "other.json"),
        capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "give either --scheduler or --scheduler-file\n")
    assert not Path("far").exists() and not Path("runs").exists()
