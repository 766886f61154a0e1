"""Numbers far from physics end in a status or in an error that names its place, never in a
traceback."""

from pathlib import Path
from typing import Any

import pytest

from sparsemor import SolveFailed, Status, load, simulate
from sparsemor.core.scene.scene import Scene
from tiers import quick

SCENES = Path(__file__).parents[2] / "scenes"


def tiny(changes: dict[str, Any]) -> Scene:
    return load(SCENES / "tiny.yaml", {"time.end": 0.003, **changes})


def radiating(surroundings: float, changes: dict[str, Any]) -> Scene:
    radiation = {"use": "radiation", "on": ["bar:top"], "emissivity": 0.5,
                 "surroundings": surroundings}
    return tiny({"loads.hot": radiation, **changes})


@pytest.mark.parametrize("surroundings", quick((1e78, 1e166, 1e245), 1e78))
def test_surroundings_whose_fourth_power_overflows(here: Path, surroundings: float) -> None:
    with pytest.raises(SolveFailed) as found:
        simulate(radiating(surroundings, {}))
    assert found.value.status is Status.NOT_FINITE and found.value.block == "bar.thermal"


def test_a_body_that_begins_so_hot(here: Path) -> None:
    with pytest.raises(SolveFailed) as found:
        simulate(radiating(300.0, {"bodies.bar.initial_temperature": 1e166}))
    assert found.value.status is Status.NOT_FINITE and found.value.block == "bar.thermal"


@pytest.mark.parametrize("method", quick(["bordered", "newton"], "newton"))
@pytest.mark.parametrize("flux", quick((1e120, 1e190), 1e190))
def test_radiation_of_a_body_heated_so_much(here: Path, flux: float, method: str) -> None:
    scene = radiating(300.0, {"loads.heating.flux": flux})
    with pytest.raises(SolveFailed) as found:
        simulate(scene.using({"reducer": {"use": "full", "method": method}}))
    assert found.value.status is Status.NOT_FINITE and found.value.block.startswith("bar.")


def test_a_training_run_heated_so_much(here: Path) -> None:
    with pytest.raises(SolveFailed, match="training") as found:
        simulate(radiating(300.0, {"loads.heating.flux": 1e190, "reducer": "galerkin"}))
    assert found.value.status is Status.NOT_FINITE


@pytest.mark.full
def test_a_stiffness_beside_which_mass_is_nothing(here: Path) -> None:
    scene = load(SCENES / "small_brake.yaml", {
        "time.end": 0.001, "reducer": "full", "bodies.disk.material.E": 1e235})
    with pytest.raises(SolveFailed) as found:
        simulate(scene)
    assert found.value.status is Status.SINGULAR and found.value.block == "disk.elastic"
