"""Every installed sparse solver selects atoms in a real scene; one that cannot is refused first."""

from pathlib import Path
from typing import Any

import pytest

from sparsemor import compare, load, simulate
from sparsemor.core.errors import InputError
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.testing import installed

BUDGETS = {"*.elastic": {"rows": 120, "atoms": 8}, "*.thermal": {"rows": 40, "atoms": 5}}


def scene_with(solver: str | dict[str, Any]) -> Scene:
    """Two links of 320 triangles for 20 steps; about half of the POD basis may be active."""
    return load("double_pendulum", {
        "bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
        # whose few snapshots span more temperatures than lumped capacity has
        "bodies.link1.capacity": "consistent", "bodies.link2.capacity": "consistent",
        "time.end": 0.02, "training.end": 0.02,
        "reducer": {"use": "sparse", "budgets": BUDGETS, "solver": solver}})


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def full(cache: Cache, tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    scene = scene_with("greedy_gauss_newton").using({"reducer": "full"})
    return simulate(scene, out=tmp_path_factory.mktemp("full") / "run", cache=cache)


@pytest.mark.full
@pytest.mark.parametrize("name", sorted(installed("sparse_solver")))
def test_every_solver_selects_in_a_scene(
    name: str, full: RunResult, cache: Cache, tmp_path: Path
) -> None:
    run = simulate(scene_with(name), out=tmp_path / name, cache=cache)
    assert run.summary["status"] == "done"
    for block, active in run.summary["atoms_active"].items():
        most = 8 if block.endswith("elastic") else 5
        assert 0 < active <= most < run.summary["atoms"][block], block
    errors = compare(full, run=run).errors["run"]
    assert errors["angle_rad"] < 1e-4, errors
    assert errors["thermal"] < 1e-2, errors


@pytest.mark.full
@pytest.mark.parametrize("name", ["basis_pursuit", "basis_pursuit_lp"])
def test_equations_that_cannot_hold_are_refused_before_the_first_step(
    name: str, cache: Cache, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="overdetermined: more rows than") as refused:
        simulate(scene_with({"use": name, "tolerance": 0}), out=tmp_path / name, cache=cache)
    assert {fault.key for fault in refused.value.faults} == {"reducer.solver"}
    assert "link1.thermal" in str(refused.value) and "link1.elastic" in str(refused.value)
