"""What a run will hold is told before it starts, and refused in words where it does not fit."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sparsemor import load, simulate
from sparsemor.core.cli import app
from sparsemor.core.errors import InputError
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.memory import limits as memory
from sparsemor.core.simulation.memory.estimate import estimate, fitting
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.plugins.comparison.cost import run_facts
from sparsemor.plugins.linear_solvers.auto import AutomaticSolver
from sparsemor.plugins.linear_solvers.superlu import Splu

SCENE = Path(__file__).parents[2] / "scenes" / "heated_disk.yaml"


def asked(tmp_path: Path, **changes: Any) -> Any:
    scene = load(SCENE, {"bodies.disk.mesh.refine": 0.5, **changes})
    return scene, *prepared(scene, Cache(tmp_path), new_manager())


def test_a_given_limit_is_the_ceiling(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(memory.LIMIT, "0.25")
    assert memory.ceiling() == memory.machine_memory() == 250_000_000
    for wrong in ("much", "-1", "0", "nan"):
        monkeypatch.setenv(memory.LIMIT, wrong)
        with pytest.raises(InputError, match="number of GB above 0"):
            memory.ceiling()


def test_a_run_that_does_not_fit_is_refused_before_it_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(memory.LIMIT, "0.001")
    out, cache = tmp_path / "out", tmp_path / "cache"
    monkeypatch.setenv("SPARSEMOR_CACHE", str(cache))
    done = CliRunner().invoke(app, [
        "run", str(SCENE), "--set", "bodies.disk.mesh.refine=0.3", "--out", str(out), "--json"])
    assert done.exit_code == 2
    (said,) = json.loads(done.stdout)["errors"]
    assert "this run would hold about" in said and "0.001 GB are there" in said
    assert "held already" in said and "take " in said
    assert not out.exists() and not cache.exists()


@pytest.mark.full
def test_the_largest_part_decides_what_is_advised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, model, offline = asked(tmp_path, reducer="full")

    class Heavy(Splu):
        def expected(self, A: Any, places: Any = None) -> int:
            return 10**15

    others = dict(model.solvers.others) | {"*.elastic": Heavy()}
    object.__setattr__(model.solvers, "others", others)
    told = estimate(scene, model, offline, exact=True)
    assert told.total > 1e15
    monkeypatch.setenv(memory.LIMIT, f"{1.5 * memory.resident() / 1e9}")  # rough counts are near it
    with pytest.raises(InputError, match=r'linear_solvers: \{"disk.elastic": amg\}'):
        fitting(scene, model, offline)


@pytest.mark.full
def test_rough_counts_bound_exact_ones(tmp_path: Path) -> None:
    scene, model, offline = asked(tmp_path, reducer="full", linear_solver="splu")
    rough, exact = (estimate(scene, model, offline, exact=e) for e in (False, True))
    assert rough.total >= exact.total > rough.base
    for name in model.reducible():
        solver, A = model.solvers.of(name), _step_matrix(model, name)
        want = solver.factorize(A, model.places(name)).memory
        assert want <= solver.expected(A, model.places(name)) <= 6 * want


def _step_matrix(model: Any, name: str) -> Any:
    data = model.block_data(name)
    return (data.stiffness + 1e6 * data.mass).tocsr()


@pytest.mark.full
def test_phases_of_a_reduced_run(tmp_path: Path) -> None:
    scene, model, offline = asked(tmp_path)
    told = estimate(scene, model, offline, exact=False)
    assert set(told.phases) == {"start", "steps", "training run", "bases"}
    simulate(scene, cache=Cache(tmp_path))
    after = estimate(scene, model, offline, exact=False)
    assert set(after.phases) == {"start", "steps", "bases"}  # the training run is in the cache
    free = load(SCENE, {"bodies.disk.mesh.refine": 0.5, "reducer.basis": "static"})
    model, offline = prepared(free, Cache(tmp_path), new_manager())
    assert set(estimate(free, model, offline, exact=False).phases) == {"start", "steps"}


@pytest.mark.full
def test_results_say_what_was_held(tmp_path: Path) -> None:
    run = simulate(load(SCENE, {"bodies.disk.mesh.refine": 0.3, "reducer": "full"}),
                   cache=Cache(tmp_path))
    held = run.summary["memory"]
    # inaccurate by pages that the kernel counts in batches, proc(5): a later reading may be smaller
    batches = 1e-3
    assert 0 < held["peak_offline_gb"] <= held["peak_gb"] <= memory.peak() / 1e9 + batches
    assert held["expected_gb"] > 0 and held["available_gb"] > 0
    facts = run_facts(run)
    assert facts.peak_gb == held["peak_gb"]
    assert "disk.elastic: splu" in facts.linear_solvers


@pytest.mark.full
def test_snapshots_must_fit_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import shutil

    from sparsemor.core.simulation.memory import estimate

    scene, model, offline = asked(tmp_path / "cache")
    monkeypatch.setattr(estimate, "HELD", 1000)
    estimate.room_for_snapshots(scene, model, offline)
    usage = shutil.disk_usage(tmp_path)._replace(free=10_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: usage)
    with pytest.raises(InputError, match="larger training.every"):
        estimate.room_for_snapshots(scene, model, offline)


def test_auto_takes_its_limit_from_the_same_place(monkeypatch: pytest.MonkeyPatch) -> None:
    from scipy.sparse import diags_array

    n = 4000
    A = diags_array([-1.0, 2.001, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tocsr()
    assert "fit in" in AutomaticSolver().choose(A)[1]
    monkeypatch.setenv(memory.LIMIT, "0.001")
    assert "exceed 0.0005 GB" in AutomaticSolver().choose(A)[1]
    assert np.isfinite(AutomaticSolver().expected(A))
