"""Reducer `auto`: the scene that it chooses repeats its run, fields that do not change are left
out, and the tolerance is kept."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import advise, load, simulate
from sparsemor.core.notes import Note
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.cache import Cache
from sparsemor.plugins.comparison.error_norms import measure_errors

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
COARSE = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
          "time.end": 0.06, "training.end": 0.06}
HEAT_FREE = {**COARSE, "loads.heating": None}
RIGID = {**HEAT_FREE, "bodies.link1.material.E": 7e16, "bodies.link2.material.E": 7e16}
AUTO = {"use": "auto", "tolerance": 1e-3}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


def equal(one: RunResult, other: RunResult) -> bool:
    return [b.name for b in one.layout] == [b.name for b in other.layout] and all(
        np.array_equal(one.block(b.name), other.block(b.name)) for b in one.layout)


@pytest.mark.full
def test_the_chosen_scene_repeats_the_run(cache: Cache, tmp_path: Path) -> None:
    scene = load("double_pendulum", {**COARSE, "reducer": AUTO})
    advice = advise(scene, cache=cache)
    assert "chosen: galerkin" in advice._repr_html_() and "\n" not in repr(advice)
    advice.save(tmp_path / "chosen.yaml")
    text = (tmp_path / "chosen.yaml").read_text()
    again = load(tmp_path / "chosen.yaml")
    assert "auto" not in text and again.digest() == advice.scene.digest()
    run = simulate(scene, cache=cache)
    assert equal(run, simulate(again, cache=cache))
    assert run.attributes["reducer"] == "galerkin"
    assert "chosen by trial runs: galerkin" in " ".join(run.summary["information"])


@pytest.mark.full
def test_the_tolerance_is_kept_in_training_and_under_other_loads(cache: Cache) -> None:
    tolerance = 1e-4
    advice = advise(load("double_pendulum", COARSE), tolerance=tolerance, cache=cache)
    assert not advice.choice.doubts
    assert all(e <= tolerance for t in advice.choice.trials[-1:] for e in t.errors.values())
    nominal = {"training.overrides": {"loads.heating.flux": 1e6}}
    for flux in (1e6, 1.2e6):
        other = advice.scene.using({**nominal, "loads.heating.flux": flux})
        full = simulate(other.using({"reducer": "full"}), cache=cache)
        worst = measure_errors(full, simulate(other, cache=cache)).worst
        assert all(worst[f] <= tolerance for f in ("elastic", "thermal")), worst


@pytest.mark.full
def test_a_nonlinear_scene_keeps_the_tolerance_under_other_loads(cache: Cache) -> None:
    """Without spare atoms the errors were 1.0e-4 to 1.8e-4."""
    scene = load(EXAMPLES / "radiating_plate.yaml")
    chosen = advise(scene, tolerance=1e-4, cache=cache).scene
    nominal = {"loads.burner.flux": 1e5, "loads.air.film": 50.0, "loads.glow.emissivity": 0.9}
    for factors in ((1.0, 1.2, 0.8), (0.8, 1.2, 1.1)):
        loads = {key: f * value for f, (key, value) in zip(factors, nominal.items(), strict=True)}
        other = chosen.using({"training.overrides": nominal, **loads})
        full = simulate(other.using({"reducer": "full"}), cache=cache)
        assert measure_errors(full, simulate(other, cache=cache)).worst["thermal"] <= 1e-4


@pytest.mark.full
def test_the_first_part_reaches_to_where_it_shows_what_follows(cache: Cache) -> None:
    """A flux on another side begins after half of the training run: bases of that half, of which
    all 23 atoms were taken, have an error of 6.5e-3 on the rest."""
    times, values = (0, 1000, 1100, 1300, 1400, 2000), (0, 0, 1e5, 1e5, 0, 0)
    late = {"use": "heat_flux", "on": ["plate:left"],
            "flux": {"use": "table", "times": times, "values": values}}
    scene = load(EXAMPLES / "radiating_plate.yaml", {"loads.late": late})
    tolerance = 1e-4
    choice = advise(scene, tolerance=tolerance, cache=cache).choice
    assert any("the first 0.75 of it" in t.method for t in choice.trials) and not choice.doubts
    assert 0.0 < choice.trials[-2].holdout["plate.thermal"] <= tolerance
    assert choice.trials[-1].atoms["plate.thermal"] <= 20


@pytest.mark.full
@pytest.mark.parametrize(("changes", "fields", "reducer"), [
    ({**COARSE, "loads.heating.flux": 0.0}, ["elastic"], "galerkin"),
    (RIGID, [], "full"),
], ids=["cold", "rigid"])
def test_fields_that_do_not_change_are_left_out(
    changes: dict[str, Any], fields: list[str], reducer: str, cache: Cache
) -> None:
    scene = load("double_pendulum", {**changes, "reducer": AUTO})
    advice = advise(scene, cache=cache)
    assert {tuple(body.fields) for body in advice.scene.bodies.values()} == {tuple(fields)}
    assert advice.choice.reducer["use"] == reducer
    run, full = simulate(scene, cache=cache), simulate(scene.using({"reducer": "full"}))
    assert {b.field for b in run.layout} == {"rigid", "multiplier", *fields}
    worst = measure_errors(full, run).worst
    assert all(worst[n] <= 1e-3 for n in ("rigid", *fields))


@pytest.mark.full
def test_a_field_that_the_training_run_may_not_show_is_kept(cache: Cache) -> None:
    """The flux begins after the training run."""
    late = {"use": "pulse", "start": 0.03, "duration": 0.01, "level": 1e6}
    scene = load("double_pendulum", {
        **COARSE, "time.end": 0.04, "training.end": 0.02, "loads.heating.flux": late})
    advice = advise(scene, tolerance=1e-2, cache=cache)
    assert not advice.left_out


@pytest.mark.full
@pytest.mark.parametrize("reason", ["", "it blows up"])
def test_an_unstable_candidate_is_not_chosen(
    reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Instability is predicted for ECSW alone; the next candidate is Galerkin projection."""
    notes = (Note(reason, "unstable"),) if reason else ()
    monkeypatch.setattr("sparsemor.plugins.advice.advice.check_run", lambda *of: (notes, {}))
    scene = load("hot_plate", {"bodies.plate.mesh.divisions": [20, 8], "time.end": 12.0})
    choice = advise(scene, tolerance=1e-2, cache=Cache(tmp_path)).choice
    assert choice.reducer["use"] == ("galerkin" if reason else "ecsw")
    assert any(reason in text for text in choice.reasons) and not choice.doubts
