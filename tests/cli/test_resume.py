"""A run that is killed and resumed ends in the same bits as one that was left alone."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import InputError, Status, load, open_result, simulate
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.results.stored_arrays import read_header, write_header

pytestmark = pytest.mark.full

TESTS = Path(__file__).parents[1]
SWING = TESTS / "scenes" / "swing.yaml"
KILLED = TESTS / "support" / "hostile" / "killed_runs.py"
PROGRAM = Path(sys.executable).with_name("sparsemor")
SHORT: dict[str, Any] = {"time.end": 0.4, "training.end": 0.4}
SELECTS = {"*.elastic": {"rows": 16, "atoms": 4}, "*.thermal": {"rows": 8, "atoms": 3}}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))


def assert_same_bits(a: RunResult, b: RunResult) -> None:
    """All that was computed; not how long it took."""
    assert (a.status, b.status) == (Status.DONE, Status.DONE)
    one, other = a.to_xarray(), b.to_xarray()
    assert set(one.variables) == set(other.variables)
    for name in set(one.variables) - {"step_seconds"}:
        np.testing.assert_array_equal(one[name].to_numpy(), other[name].to_numpy(), name)
    for key in ("steps", "t_end", "newton_iterations", "support_changes", "atoms_active", "probes",
                "rows"):
        assert a.summary[key] == b.summary[key], key
    assert a.summary.get("control") == b.summary.get("control")


CASES = {
    "bdf1 full": ({"reducer": "full"}, ["step:3", "step:200", "step:201", "step:399"]),
    "bdf1 galerkin": ({"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 6}}},
                      ["training:57", "step:57", "replace:9", "step:333"]),
    "bdf1 sparse, selecting": ({"reducer.budgets": SELECTS}, ["step:121", "step:390"]),
    "sparse, selecting, rows always new": (
        {"reducer.budgets": SELECTS, "reducer.resample": 7}, ["step:121", "replace:8"]),
    "alpha full": ({"reducer": "full", "integrator": "generalized_alpha"},
                   ["replace:4", "replace:7", "replace:2", "step:255"]),
    "alpha galerkin": ({"reducer": {"use": "galerkin"}, "integrator": "generalized_alpha"},
                       ["step:1", "step:83", "replace:12"]),
    "alpha sparse, selecting": (
        {"reducer.budgets": SELECTS, "reducer.every": 2, "reducer.hysteresis": 0.5,
         "integrator": "generalized_alpha"},
        ["step:100", "replace:7"]),
    "bdf2 galerkin": ({"reducer": {"use": "galerkin"}, "integrator": "bdf2"},
                      ["step:2", "step:83", "replace:12"]),
    "controlled bdf2 full": (
        {"reducer": "full", "integrator": "bdf2", "time.step": 0.004, "training.every": 1,
         "time.control": {"tolerance": 1e-4, "elastic": 1.0}}, ["step:7", "replace:5", "step:77"]),
    "controlled bdf1 sparse, selecting": (
        {"reducer.budgets": SELECTS, "time.step": 0.004,
         "training.every": 1,
         "time.control": {"tolerance": 0.1, "elastic": 1.0}}, ["training:9", "step:3", "step:60"]),
    "every 7th step stored": ({"reducer": "full", "output.every": 7}, ["step:333", "step:350"]),
}


QUICK = ("bdf1 full", "bdf1 sparse, selecting", "alpha galerkin", "controlled bdf2 full")


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name not in QUICK)) for name in CASES])
def test_killed_and_resumed(name: str, tmp_path: Path) -> None:
    changes, moments = CASES[name]
    settings = SHORT | changes
    done = subprocess.run(
        [sys.executable, KILLED, SWING, "killed", json.dumps(settings), *moments],
        capture_output=True, text=True, check=True)
    assert done.stdout.split() == [*[str(-signal.SIGKILL)] * len(moments), "0"]
    whole = simulate(load(SWING, settings), out=tmp_path / "whole")
    assert_same_bits(open_result("killed"), whole)
    if "selecting" in name:
        assert whole.summary["support_changes"] > 2
        assert whole.summary["atoms_active"]["arm.elastic"] <= 4


def started(*arguments: str, sign: str = "out/result.checkpoint") -> subprocess.Popen[str]:
    """The program in a process of its own, as soon as its run has written the file `sign`."""
    process = subprocess.Popen([PROGRAM, *arguments], stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True)
    for _ in range(3000):
        if Path(sign).exists() or process.poll() is not None:
            break
        time.sleep(0.01)
    assert process.poll() is None, process.communicate()
    return process


LONG = ["--set", "reducer=full", "--set", "time.end=5", "--out", "out"]
WAITS = '''
"""A check that waits in step 100 of the first run until it is told to go on."""

import time
from pathlib import Path

from sparsemor.core import Check


class Waits(Check):
    """Waits."""

    def on_start(self, run, state, whole):
        return self._look

    def _look(self, done, before, state, active):
        if done == 100 and not Path("waiting").exists():
            Path("waiting").touch()
            for _ in range(60_000):
                if Path("go_on").exists():
                    break
                time.sleep(0.01)
'''


def test_ctrl_c_leaves_a_run_that_can_be_continued(
    tmp_path: Path, distribute: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    distribute("waits-pkg", {"check": {"waits": "waits_check:Waits"}}, waits_check=WAITS)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site-waits-pkg"))
    short = ["--set", "reducer=full", "--set", "time.end=0.4", "--out", "out"]
    process = started("run", str(SWING), *short, sign="waiting")
    process.send_signal(signal.SIGINT)
    Path("go_on").touch()
    out, err = process.communicate(timeout=600)
    assert (process.returncode, out) == (130, "")
    first, second = err.splitlines()
    assert first.startswith("interrupted at t = ")
    assert first.endswith(": continue it with --resume")
    assert second == f"results up to the failure: {tmp_path / 'out' / 'result'}"
    stopped = open_result("out")
    assert stopped.status is Status.INTERRUPTED
    assert 0 <= stopped.summary["steps"] <= 100
    assert stopped.times[-1] == pytest.approx(stopped.summary["t_end"], rel=1e-9)
    done = subprocess.run([PROGRAM, "run", SWING, *short, "--resume", "--json"],
                          capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["steps"] == 400
    whole = simulate(load(SWING, {"reducer": "full", "time.end": 0.4}), out="whole")
    assert_same_bits(open_result("out"), whole)


def test_a_killed_program_leaves_a_store_that_opens() -> None:
    process = started("run", str(SWING), *LONG)
    process.kill()
    process.communicate(timeout=600)
    left = open_result("out")
    assert left.status is Status.INTERRUPTED and left.summary == {}
    assert np.isfinite(left.block("arm.elastic")).all()
    assert len({len(v) for n, v in left.to_xarray().items() if v.dims[0] == "time"}) == 1


def refusal(*arguments: str) -> str:
    done = subprocess.run([PROGRAM, "run", SWING, *arguments], capture_output=True, text=True,
                          check=False)
    assert (done.returncode, done.stdout) == (2, "")
    return done.stderr


def test_what_cannot_be_resumed() -> None:
    scene = load(SWING, {"reducer": "full", "time.end": 0.05})
    simulate(scene, out="out")
    kept = {p: p.stat().st_mtime_ns for p in Path("out").rglob("*")}
    asked = ["--set", "reducer=full", "--set", "time.end=0.05", "--out", "out"]
    assert "cannot be resumed: the run has ended; nothing is left to do" in refusal(
        *asked, "--resume")
    assert "made with time.end 0.05, and a run is continued to a later one (got 0.04)" in refusal(
        *asked, "--resume", "--set", "time.end=0.04")
    assert "not empty: use --resume to continue" in refusal(*asked)
    document = read_header(Path("out/result"))
    document["attributes"]["status"] = "interrupted"
    write_header(Path("out/result"), document)
    checkpoint = Path("out/result.checkpoint").read_bytes()
    assert "it was made from another scene" in refusal(
        *asked, "--resume", "--set", "loads.sun.flux=1")
    Path("out/result.checkpoint").unlink()
    assert "stopped before its first checkpoint" in refusal(*asked, "--resume")
    Path("out/result.checkpoint").write_bytes(checkpoint)
    assert set(kept) == set(Path("out").rglob("*"))
    with pytest.raises(InputError, match="needs the directory of the result"):
        simulate(scene, resume=True)


def saved() -> int:
    """When the run in `out` was last saved, ns; 0: never."""
    checkpoint = Path("out/result.checkpoint")
    return checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0


@pytest.mark.slow
def test_the_packaged_scene_killed_at_random_moments() -> None:
    rng = np.random.default_rng(20)
    settings = ["--set", "time.end=4", "--set", "training.end=4", "--set",
                'reducer.budgets={"*.elastic": {rows: 240, atoms: 15}, '
                '"*.thermal": {rows: 80, atoms: 10}}']
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([PROGRAM, "run", "double_pendulum", *settings, "--out", "whole"], check=True,
                   env=environment, capture_output=True)
    command = [PROGRAM, "run", "double_pendulum", *settings, "--out", "out"]
    kills, resume = 0, []
    while kills < 5:
        process = subprocess.Popen([*command, *resume], env=environment,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        before = saved()
        while process.poll() is None and saved() == before:
            time.sleep(0.002)
        time.sleep(0.1 * rng.random())  # somewhere after the next save, however busy the machine
        if process.poll() is not None:
            break
        process.kill()
        process.wait()
        kills += 1
        resume = ["--resume"] if Path("out/result.checkpoint").exists() else []
    assert kills >= 2
    subprocess.run([*command, *resume], env=environment, capture_output=True, check=False)
    assert_same_bits(open_result("whole"), open_result("out"))
