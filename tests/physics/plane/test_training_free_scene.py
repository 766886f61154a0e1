"""The heated pendulum from its operators alone: no training run, and errors that are known."""

from pathlib import Path
from typing import Any

import pytest

from small_scenes import coarse_pendulum
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate
from sparsemor.plugins.comparison.compare import compare

pytestmark = pytest.mark.full

RATES = [0, 1, 3, 10, 30, 100, 300, 1000]
HEAT = {"use": "static", "rates": RATES, "orthonormal": True}


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    return run({"use": "full"}, tmp_path_factory.mktemp("full"))


def run(reducer: dict[str, Any], folder: Path) -> RunResult:
    scene = coarse_pendulum().using({"reducer": reducer})
    return simulate(scene, out=folder / "run", cache=Cache(folder / "cache"))


# worst errors of the elastic and thermal fields, two to four times what was measured
@pytest.mark.parametrize(("reducer", "elastic", "thermal"), [
    ({"basis": {"use": "static", "rates": [0, 10, 100, 1000]}}, 3e-4, 2e-3),
    ({"basis": HEAT}, 5e-5, 2e-7),
    ({"basis": {"use": "dictionary", "bases": [HEAT, "modal"], "orthonormal": True}}, 4e-8, 1e-7),
    ({"basis": {"use": "dictionary", "bases": ["craig_bampton", HEAT], "orthonormal": True},
      "bases": {"*.thermal": HEAT}}, 1e-7, 2e-7),
], ids=["4 rates", "8 rates", "rates+modes", "rates+craig_bampton"])
def test_galerkin_without_training(
    reducer: dict[str, Any], elastic: float, thermal: float, full: RunResult, tmp_path: Path
) -> None:
    result = run({"use": "galerkin", **reducer}, tmp_path)
    assert set(result.summary["cache"]) - {"span"} == {
        "basis", "galerkin_error", "trial_space"}
    errors = compare(full, reduced=result).errors["reduced"]
    assert errors["elastic"] < elastic and errors["thermal"] < thermal
    assert errors["angle_rad"] < 1e-4


def test_a_basis_is_that_of_the_scene_that_runs(tmp_path: Path) -> None:
    """Two scenes with one training scene and other loads share snapshots, not responses."""
    pull = {"use": "point_force", "on": "link2:right", "force": [0.0, 5.0]}
    push = {**pull, "on": "link2:left"}
    names = []
    for load_ in (pull, push):
        scene = coarse_pendulum().using({
            "time.end": 0.01, "training.end": 0.01, "loads.tip": load_, "reducer": {
                "use": "galerkin", "basis": "static"},
            "training.overrides": {"loads.tip": pull}})
        result = simulate(scene, out=tmp_path / str(len(names)), cache=Cache(tmp_path / "cache"))
        names.append(result.summary["cache"]["basis"])
    # link 1 and both thermal blocks are the same in both scenes
    assert names == ["miss", "mixed"]


def test_a_basis_of_snapshots_in_a_dictionary_trains(tmp_path: Path) -> None:
    bases = ["modal", {"use": "pod", "count": 5}]
    result = run({"use": "galerkin",
                  "basis": {"use": "dictionary", "bases": bases, "orthonormal": True}}, tmp_path)
    assert set(result.summary["cache"]) == {
        "basis", "galerkin_error", "training", "trial_space"}


def test_sampled_rows_take_training_free_bases(full: RunResult, tmp_path: Path) -> None:
    """Rows of every node that heat or a joint touches, and some more: as good as Galerkin."""
    result = run({
        "use": "sparse", "basis": HEAT, "sampler": "lhs",
        "budgets": {"*.elastic": {"rows": 80}, "*.thermal": {"rows": 60}}}, tmp_path)
    assert "training" not in result.summary["cache"]
    errors = compare(full, reduced=result).errors["reduced"]
    assert errors["thermal"] < 3e-7 and errors["elastic"] < 5e-4
