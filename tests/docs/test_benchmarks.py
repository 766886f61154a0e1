"""Each benchmark script runs on tiny sizes, prints its tables and meets targets that hold there.

What their numbers say is said by the pages; that they follow from the product's own runs, by the
test of `compare` below.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from sparsemor import compare, load, simulate
from sparsemor.core.simulation.cache import Cache

pytestmark = pytest.mark.full

SCRIPTS = Path(__file__).parents[1] / "benchmarks"
Printed = Callable[..., tuple[Path, str]]
SHORT = ("cost", "compiled_steps", "chains", "accuracy", "selection", "recovery --packaged",
         "recovery --constants", "recovery --screening", "untf", "hot_pendulum", "step_sizes",
         "third_party_reducer", "kept_model", "selected_fields")
LONG = ("published", "recovery", "samplers", "hyper_reduction", "nonlinear_heat", "stability",
        "slider_variants", "slider", "linear_solvers", "brake_disk", "brake_disk_fine", "scaling",
        "travelling_source")
NOT_TIMED = {"accuracy", "hyper_reduction", "stability", "step_sizes"}
"""All targets of these are of errors, which a short run keeps, too."""
WITHOUT_ROWS = {
    "stability": {"Every disagreement"},
    "scaling": {"The same over longer runs", "Galerkin with given atoms: error of each block"}}
"""Tables in which a short run has no rows: no prediction is wrong, no run is long."""


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> Printed:
    """printed(script, *words): the folder of its results, and what it prints on its way to success.
    All share a cache of offline products."""
    folder = tmp_path_factory.mktemp("benchmarks")

    @cache
    def run(script: str, *words: str) -> tuple[Path, str]:
        out = folder / "".join((script.replace("/", "-"), *words))
        out.mkdir()
        written = [] if script == "errors/advice" else ["--out", out / "out.json"]
        done = subprocess.run(
            [sys.executable, SCRIPTS / f"{script}.py", "--quick", *words, *written],
            env=os.environ | {"SPARSEMOR_CACHE": str(folder / "cache")}, capture_output=True,
            text=True)
        assert done.returncode == 0, done.stderr
        return out / "out.json", done.stdout

    return run


@pytest.mark.parametrize("script", [
    *SHORT, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)])
def test_a_script_prints_and_writes_its_tables(script: str, printed: Printed) -> None:
    name, *options = script.split()
    out, text = printed(name, *options)
    found = json.loads(out.read_text(encoding="utf-8"))
    assert text.startswith(f"{name}: done") and found["settings"]["threads"].startswith("1 ")
    assert found["tables"] and all(table["title"] in text for table in found["tables"])
    empty = {table["title"] for table in found["tables"] if not table["rows"]}
    assert empty == WITHOUT_ROWS.get(name, set())
    if name in NOT_TIMED:
        assert {target["verdict"] for target in found["targets"]} == {"met"}


def test_every_script_runs() -> None:
    scripts = {p.stem for p in SCRIPTS.glob("*.py")}
    # blade, cluster: what they measure has tests of its own
    apart = {"blade", "cluster", "common", "other_code", "walk", "writing"}
    assert scripts - apart == {name.split()[0] for name in (*SHORT, *LONG)}


@pytest.mark.slow
def test_models_of_a_box_and_chosen_models_are_measured(printed: Printed) -> None:
    out, text = printed("errors/parameters")
    assert "trained at 9 points" in text and "CPU time of a whole run" in text
    assert len((out / "double_pendulum.csv").read_text(encoding="utf-8").splitlines()) == 3
    for line, tolerance in zip(printed("errors/advice")[1].splitlines()[-3:],
                               (1e-2, 1e-3, 1e-4), strict=True):
        cells = [c.strip() for c in line.strip("|").split("|")]
        assert cells[:2] == ["double_pendulum", f"{tolerance:g}"] and cells[7] == "0 of 1"
        assert all(0.0 < float(cell) < tolerance for cell in cells[3:7])


def test_errors_of_runs_in_memory_are_those_of_compare(printed: Printed, tmp_path: Path) -> None:
    tables = json.loads(printed("selection")[0].read_text(encoding="utf-8"))["tables"]
    (row,) = (r for table in tables if table["title"] == "Selection" for r in table["rows"]
              if r["variant"] == "leading atoms, galerkin")
    bases = {"basis": {"use": "pod", "count": 6},
             "bases": {"*.thermal": {"use": "pod", "count": 4}}}
    scene = load("double_pendulum", {
        "bodies.link1.capacity": "consistent", "bodies.link2.capacity": "consistent",
        "time.end": 0.06, "training.end": 0.06, "reducer": {"use": "galerkin", **bases}})
    kept = Cache(tmp_path / "cache")
    full = simulate(scene.using({"reducer": "full"}), out=tmp_path / "full", cache=kept)
    reduced = simulate(scene, out=tmp_path / "galerkin", cache=kept)
    measured = compare(full, errors_from=0.03, reduced=reduced)
    assert row["angle"] == pytest.approx(measured.errors["reduced"]["angle_rad"], rel=1e-3)
    assert row["thermal"] == pytest.approx(measured.errors["reduced"]["thermal"], rel=1e-3)
    assert row["elastic"] == pytest.approx(measured.late_errors["reduced"]["elastic"], rel=1e-3)


def test_an_interrupted_benchmark_prints_what_it_has(tmp_path: Path) -> None:
    out = tmp_path / "accuracy.json"
    with subprocess.Popen(
        [sys.executable, SCRIPTS / "accuracy.py", "--seeds", "1", "0", "--out", out],
        env=os.environ | {"SPARSEMOR_CACHE": str(tmp_path / "cache")},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as process:
        assert process.stderr is not None
        assert "full order" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        text, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert text.startswith("accuracy: INTERRUPTED")
    assert json.loads(out.read_text())["interrupted"] is True
