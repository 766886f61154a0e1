"""Loads that may vary: functions of time of the training runs, faults, and models that hold for
loads which no training run had."""

from typing import Any

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor import InputError, reduce, simulate
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation import training
from sparsemor.core.simulation.training import training_steps
from sparsemor.core.status import SolveFailed, Status
from sparsemor.plugins.checks.loads_and_training import unvaried_loads
from sparsemor.plugins.comparison.error_norms import measure_errors

FLUX, PUSH = "loads.heating.flux", "loads.push.factor"
LOADS = {
    "push": {"use": "traction", "on": ["bar:top"], "traction": [0.0, -1.0e4],
             "factor": {"use": "ramp", "end": 0.02, "final": -2.0}},
    "film": {"use": "convection", "on": ["bar:bottom"], "film": 200.0, "temperature": 293.15}}


def varying(loads: Any, **changes: Any) -> Scene:
    scene = tiny().using({f"loads.{n}": load for n, load in LOADS.items()})
    return scene.using({"training.loads": loads, **changes})


def test_each_load_varies_alone_and_all_together() -> None:
    scene = varying("varying")
    one, other, *together = scene.training_changes
    assert set(one) == set(other) == {FLUX, PUSH} and len(together) == 3
    assert one[PUSH] == other[FLUX] == 0.0
    assert scene.training_runs == 5 and training_steps(scene) == 0
    for changes in together:
        assert all(changes[key]["use"] == "table" for key in (FLUX, PUSH))
    for own, key, large in ((one, FLUX, 1.0e6), (other, PUSH, -2.0)):
        f = np.array(own[key]["values"])
        assert f[0] == large and set(np.abs(f)) == {0.0, abs(large)}, "first towards its own sign"
        assert own[key]["times"][-1] == pytest.approx(scene.training_end)
        assert np.all(np.diff(own[key]["times"]) > 0.0)


def test_ranges_and_levels() -> None:
    scene = varying({"heating": [0.0, 5.0], "film": [280.0, 350.0]})
    heated, _, *together = scene.training_changes
    level = "loads.film.temperature"
    assert set(heated) == {FLUX}, "the surroundings keep their temperature"
    for changes in together:
        assert min(changes[FLUX]["values"]) >= 0.0 and max(changes[FLUX]["values"]) <= 5.0
        assert 280.0 <= min(changes[level]["values"]) <= max(changes[level]["values"]) <= 350.0
    ranged = varying({"heating": [0.0, 5.0]}, **{FLUX: 3.0})
    assert ranged.training_changes == varying({"heating": [0.0, 5.0]}).training_changes


FAULTS: list[tuple[Any, dict[str, Any], str, str]] = [
    ("all", {}, "training.loads", "varying"),
    ([], {}, "training.loads", "at least 1"),
    (["haeting"], {}, "training.loads.0", "did you mean heating"),
    (["gravity"], {}, "training.loads.0", "no function of time"),
    (["heating"], {"parameters": {"flux": {"key": FLUX, "range": [1.0, 2.0e6]}}},
     "training.loads.0", "as a parameter"),
    ({"push": [1.0, 1.0]}, {}, "training.loads.push", "the smaller one"),
    (["push"], {"training.overrides": {PUSH: 1.0}}, "training.overrides.loads.push.factor",
     "no effect"),
]


@pytest.mark.parametrize("loads,changes,key,words", FAULTS)
def test_faults_are_located(loads: Any, changes: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        varying(loads, **changes)
    assert {f.key for f in error.value.faults} == {key}
    assert words in str(error.value)


def test_a_scene_without_loads_is_refused() -> None:
    with pytest.raises(InputError, match="no load of the scene has"):
        tiny().using({"loads": {}, "training.loads": "varying"})


def test_loads_of_one_value_do_not_vary_and_a_model_reports_it() -> None:
    still = varying("varying", **{PUSH: 0.0})
    assert list(still.unvaried_loads) == [PUSH] and len(still.training_changes) == 4
    assert list(varying(["film", "push"]).unvaried_loads) == ["loads.film.temperature"]
    assert varying({"push": [0.0, 1.0]}, **{PUSH: 0.0}).unvaried_loads == {}
    assert varying(["push"], **{PUSH: 0.0}).training_changes == [{}]
    (note,) = unvaried_loads(still.using({"reducer": "galerkin"}))
    assert "push.factor is 0 at all times" in note.text
    assert not list(unvaried_loads(still.using({"reducer": "full"})))


@pytest.mark.full
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_auto_holds_for_loads_that_no_training_run_had(tolerance: float) -> None:
    scene = varying("varying", reducer={"use": "auto", "tolerance": tolerance})
    model, end = reduce(scene), scene.time.end
    assert "tolerance_unmet" not in model.run().summary["note_kinds"]
    for flux, push in ((-5.0e5, {"use": "sine", "amplitude": 1.0, "frequency": 2.0 / end}),
                       ({"use": "pulse", "duration": 0.3 * end, "level": 1.0e6}, 0.0)):
        loads = {FLUX: flux, PUSH: push}
        full = simulate(scene.using({**loads, "reducer": "full"}))
        errors = measure_errors(full, model.run(loads))
        assert max(errors.series[n].max() for n in ("bar.elastic", "bar.thermal")) <= tolerance


def test_a_training_run_that_fails_under_loads_advises_on_their_ranges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: object) -> None:
        raise SolveFailed(Status.NOT_CONVERGED, 0.01, "bar.elastic", "training run")

    monkeypatch.setattr(training, "train", fails)
    scene = varying({"push": [-9.0, 9.0]}, reducer="galerkin")
    with pytest.raises(SolveFailed, match=r"t = 0.01 s in bar.elastic.*training.loads declares"):
        simulate(scene)


@pytest.mark.full
@pytest.mark.parametrize("loads", ["varying", ["heating"]])
def test_superpositions_of_training_are_in_its_range(loads: Any) -> None:
    """Ten times the load: the same shapes, if all loads vary. The bar swings, so that this holds
    for its temperatures alone."""
    model = reduce(varying(loads, reducer={"use": "galerkin", "basis": {"use": "pod", "count": 9}}))
    summary = model.run({FLUX: 1.0e7}).summary  # no warning where the estimated error is small
    notes = [n for n in (*summary["notes"], *summary["information"]) if "left the range" in n]
    assert any("bar.thermal" in n for n in notes) == (loads != "varying")
