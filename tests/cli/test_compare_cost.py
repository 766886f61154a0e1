"""`sparsemor compare` builds each body once, solves full order once, and draws only when asked."""

import json
from collections import Counter
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sparsemor import load, open_result, plot, simulate
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.core.cli import app
from sparsemor.core.model import assembly
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.plugins.charts.comparison_points import work_notes, work_points
from sparsemor.plugins.comparison.command import variants
from sparsemor.plugins.comparison.compare import compare
from sparsemor.reducers.full.reducer import Full

SCENES = Path(__file__).parents[1] / "scenes"
TINY, BRAKE = str(SCENES / "tiny.yaml"), str(SCENES / "small_brake.yaml")

pytestmark = pytest.mark.usefixtures("here")


def compared(*arguments: str) -> Any:
    done = CliRunner().invoke(app, ["compare", *arguments, "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def alike(one: RunResult, other: RunResult) -> bool:
    """True if two runs agree: their training runs were solved to 1e-13 and to 1e-11. The joint
    force at the start depends on round-off of the last atoms (docs/decisions/0044)."""
    return all(np.abs((one.block(b.name) - other.block(b.name))[1:]).max()
               <= 1e-8 * np.abs(other.block(b.name)).max() for b in other.layout)


@pytest.mark.full
def test_one_model_one_full_order_run_no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: Counter[str] = Counter()

    def counted(owner: Any, name: str) -> None:
        made = getattr(owner, name)

        @wraps(made)
        def call(*args: Any, **kwargs: Any) -> Any:
            counts[name] += 1
            return made(*args, **kwargs)
        monkeypatch.setattr(owner, name, call)

    counted(Rectangle, "build")
    counted(assembly, "Records")  # of one model
    counted(Full, "prepare")
    found = compared(TINY, "--training-end", "1", "--no-charts", "--out", "out")
    # the second step solver is that of half steps, for the time error of the reference
    assert counts == {"build": 1, "Records": 1, "prepare": 2}
    assert {p.suffix for p in Path("out").iterdir() if p.is_file()} == {".csv", ".jsonl"}
    galerkin = next(r for r in found["runs"] if r["run"] == "galerkin")
    assert galerkin["cache"]["training"] == "hit"
    full = next(r for r in found["runs"] if r["run"] == "full")
    assert galerkin["offline_whole_s"] > full["wall_s"]["online"], "the training run has a price"
    alone = simulate(load(TINY, {"reducer": "galerkin"}), cache=Cache("other"))
    assert alike(open_result("out/galerkin"), alone)


@pytest.mark.full
def test_snapshots_are_left_by_runs_that_begin_with_the_training_run() -> None:
    cache = Cache("kept")
    full = load(TINY, {"time.end": 0.02, "reducer": "full"})
    simulate(full, cache=cache)
    assert not [e for e in cache.entries() if e.kind == "training"], "nobody asked for them"
    half = full.using({"training.end": 0.01})
    for other in ({"time.end": 0.005}, {"training.overrides": {"loads.heating.flux": 1.0}},
                  {"training.overrides": {"time.step": 5e-4}}):
        simulate(half.using(other), cache=cache, keep_training=True)
        assert not [e for e in cache.entries() if e.kind == "training"], "trained on another run"
    simulate(half, cache=cache, keep_training=True)
    runs = [simulate(half.using({"reducer": "galerkin"}), cache=c) for c in (cache, Cache("none"))]
    assert [r.summary["cache"]["training"] for r in runs] == ["hit", "miss"]
    assert alike(*runs)
    simulate(full, cache=cache, keep_training=True)
    run = simulate(full.using({"reducer": "galerkin"}), cache=cache)
    assert run.summary["cache"]["training"] == "hit"


@pytest.mark.full
def test_default_reducers_run_on_a_scene_that_names_no_budgets() -> None:
    """Atoms of `sparse` follow from the dictionary; it takes all rows."""
    found = compared(BRAKE, "--training-end", "1", "--no-charts", "--out", "out")
    assert [r["status"] for r in found["runs"]] == ["done"] * 3
    sparse = next(r for r in found["runs"] if r["run"] == "sparse")
    assert not sparse["rows"] and min(sparse["atoms"].values()) > 1
    assert max(found["errors"]["sparse"].values()) < 1e-3


def test_a_sampler_is_not_handed_to_reducers_whose_own_is_another() -> None:
    scene = load(TINY, {"reducer": {"use": "sparse", "sampler": "random", "basis": "modal",
                                    "max_iterations": 12}})
    made = {n: s.dump()["reducer"] for n, s in variants(scene, ["full", "deim", "gnat"]).items()}
    assert made["deim"]["sampler"]["use"] == made["gnat"]["sampler"]["use"] == "deim"
    assert made["deim"]["basis"]["use"] == made["gnat"]["basis"]["use"] == "modal"
    assert made["deim"]["max_iterations"] == 12


@pytest.mark.full
def test_runs_with_different_unknowns_are_compared_on_what_they_share() -> None:
    heated = simulate(load(TINY, {"time.end": 0.02}))
    cold = simulate(load(TINY, {
        "time.end": 0.02, "bodies.bar.fields": ["elastic"], "loads.heating": None}))
    found = compare(heated, cold=cold)
    assert set(found.errors["cold"]) == {
        "combined", "rigid", "elastic", "bar.rigid", "bar.elastic", "angle_rad"}
    assert 0.0 < found.errors["cold"]["bar.elastic"]
    assert "not compared" in str(found) and "bar.thermal" in str(found)


@pytest.mark.full
def test_the_stability_check_is_kept_with_its_inputs() -> None:
    cache, scene = Cache("kept"), load(TINY, {"time.end": 0.02, "reducer": "sparse"})
    first, again = (simulate(scene, cache=cache).summary for _ in range(2))
    assert [s["cache"]["stability"] for s in (first, again)] == ["miss", "hit"]
    assert first["stability"] == again["stability"] and again["stability"]["stable"]
    other = simulate(scene.using({"seed": 9}), cache=cache).summary
    assert other["cache"]["stability"] == "miss"


@pytest.mark.full
def test_errors_after_the_end_of_training_are_tabulated_and_drawn() -> None:
    """They are by default: the scene trains on all of its run, `compare` on half of it."""
    found = compared(TINY, "--reducers", "full,galerkin", "--no-charts", "--out", "half")
    assert found["trained_to"] == pytest.approx(0.02)
    assert found["late_errors"]["galerkin"]["elastic"] > 0.0
    runs = {name: open_result(f"half/{name}") for name in ("full", "galerkin")}
    comparison = compare(runs["full"], galerkin=runs["galerkin"], failed={"deim": "singular"})
    points, _ = work_points(comparison)
    assert points[0].errors == comparison.late_errors["galerkin"]
    gain, full, own = comparison.gains["galerkin"], *comparison.facts.values()
    whole = (full.offline_seconds or 0.0) + (full.online_seconds or 0.0)
    assert gain.again == pytest.approx(whole / (own.online_seconds or 0.0))
    assert gain.once < gain.again
    notes = work_notes(comparison)
    assert notes[0] == "errors after 0.02 s, the end of training"
    assert "trained to 0.02 s of 0.04 s: galerkin" in notes
    assert notes[-1] == "failed: deim: singular"
    for line in notes[1:]:
        assert line in str(comparison) or "offline" in line
    from matplotlib.text import Text  # half a second

    drawn = "\n".join(t.get_text() for t in plot(comparison).findobj(Text))
    assert all(note[:40] in drawn for note in notes)
    lines = plot(comparison, "error_over_time").findobj(Text)
    assert any("end of training" in t.get_text() for t in lines)
    whole_run = compare(runs["full"], galerkin=simulate(load(TINY, {"reducer": "galerkin"})))
    assert whole_run.trained_to == 0.0
    assert "errors in training, on the run of which the basis was made: galerkin" in str(whole_run)
