"""What a reduced run does where its estimated error exceeds the tolerance, and the check of its
trial space before it."""

import os
import signal
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor.core import hookimpl
from sparsemor.core.errors import InputError
from sparsemor.core.results.run_result import RunResult, open_result
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.status import SolveFailed, Status
from sparsemor.plugins.comparison.compare import compare
from sparsemor.plugins.comparison.error_norms import Errors, measure_errors
from sparsemor.plugins.kept_models.reduced_model import reduce

SEGMENTS, STEPS = 8, 64
TOLERANCE = 0.02


def passing(action: str, every: int = 2, **changes: Any) -> Scene:
    """A strip heated by a source that passes over its top; trained on the first quarter of the
    path."""
    width, dwell = 0.2 / SEGMENTS, 8e-3
    loads = {f"source{i}": {
        "use": "heat_flux", "on": [f"bar:top{i}"], "flux": {
            "use": "pulse", "start": i * dwell + 5e-4, "duration": dwell, "level": 1e7}}
        for i in range(SEGMENTS)}
    sets = {f"top{i}": {"where": f"y > 0.0199 and x > {i * width - 1e-6} and "
                                 f"x < {(i + 1) * width + 1e-6}"} for i in range(SEGMENTS)}
    estimate = {"every": every, "tolerance": TOLERANCE, "action": action}
    return Scene.model_validate({
        "format": 1,
        "bodies": {"bar": {
            "use": "flexible", "frame": "fixed", "fields": ["thermal"], "thickness": 0.02,
            "mesh": {"use": "rectangle", "size": [0.2, 0.02], "divisions": [2 * SEGMENTS, 3]},
            "sets": sets, "material": {"rho": 2700, "k": 150, "c": 900}}},
        "loads": loads, "time": {"end": STEPS * 1e-3, "step": 1e-3}, "integrator": "bdf1",
        "training": {"end": 0.016},
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 12},
                    "error_estimate": estimate}}).using(changes)


@cache
def reference() -> RunResult:
    return simulate(passing("warn").using({"reducer": "full"}))


def errors(run: RunResult) -> Errors:
    return measure_errors(reference(), run)


class Strikes:
    """Ctrl-C after a step."""

    def __init__(self, step: int) -> None:
        self.last = step

    @hookimpl
    def on_step(self, step: int) -> None:
        if step == self.last:
            os.kill(os.getpid(), signal.SIGINT)


def stopped(scene: Scene, **how: Any) -> SolveFailed:
    with pytest.raises(SolveFailed) as found:
        simulate(scene, **how)
    return found.value


@pytest.mark.parametrize(("changes", "key", "words"), [
    ({"reducer.error_estimate": None}, "reducer.error_estimate", "or: Input should be keys"),
    ({"reducer.error_estimate.every": "x"}, "reducer.error_estimate.every", "a valid integer"),
    ({"reducer.error_estimate": 65}, "reducer.error_estimate", "the run has 64 steps"),
    ({"reducer.error_estimate.every": 65}, "reducer.error_estimate", "the run has 64 steps")])
def test_faults_of_the_option_are_located(
    changes: dict[str, Any], key: str, words: str
) -> None:
    with pytest.raises(InputError, match=words) as error:
        checked_model(passing("stop", **changes))
    assert [f.key for f in error.value.faults] == [key]


@pytest.mark.full
def test_a_source_not_seen_in_training_is_caught_and_full_order_brings_the_error_back(
    tmp_path: Path,
) -> None:
    """Caught before the true error passes ten times the tolerance."""
    blind = errors(simulate(passing("warn")))
    assert blind.worst["thermal"] > 0.5
    early = stopped(passing("stop"))
    assert early.status is Status.INACCURATE and early.block == "bar.thermal"
    assert isinstance(early.result, RunResult)
    assert errors(early.result).worst["thermal"] < 10 * TOLERANCE
    run = simulate(passing("fall_back"), out=tmp_path / "run")
    assert errors(run).worst["thermal"] < TOLERANCE
    told = run.summary["fall_back"]
    assert told["time"] == pytest.approx(early.time - 2e-3) and told["block"] == "bar.thermal"
    assert told["steps"] == STEPS - round(told["time"] / 1e-3) and told["seconds"] > 0.0
    assert "fell_back" in run.summary["note_kinds"]
    assert run.error_estimates == ("bar.thermal",) and not run.reduced("bar.thermal")
    assert run.reducer == "galerkin" and len(run.times) == STEPS + 1
    assert not (tmp_path / "run" / ".result.old").exists()
    assert f"run: {told['steps']} steps from 0.016 s on at full order" in str(
        compare(reference(), run=run))


@pytest.mark.full
def test_atoms_of_full_order_steps_bring_the_error_back(tmp_path: Path) -> None:
    """Fewer full-order steps than without them, coefficients of all steps in the new atoms."""
    run = simulate(passing("enrich"), out=tmp_path)
    assert errors(run).worst["thermal"] < TOLERANCE
    assert 0.5 < errors(run).effectivity["bar.thermal"] < 2.0
    told = run.summary["enriched"]
    assert run.summary["fall_back"] == {} and 1 <= len(told["times"]) <= 4
    assert 10 <= told["steps"] < STEPS - 16 and told["seconds"] > 0.0
    assert run.reduced("bar.thermal") and run.atoms("bar.thermal").shape[1] > 12
    assert any("atoms were added" in text for text in run.summary["information"])
    before = run.times <= told["times"][0]
    plain = simulate(passing("warn"))
    np.testing.assert_allclose(
        run.block("bar.thermal")[before], plain.block("bar.thermal")[before], rtol=1e-10)


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["generalized_alpha"])
def test_atoms_are_added_to_a_moving_body_too(integrator: str) -> None:
    """Two vibration modes of a hinged, heated bar."""
    scene = tiny().using({"integrator": integrator, "reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 3},
        "bases": {"*.elastic": {"use": "modal", "count": 2}},
        "error_estimate": {"every": 2, "tolerance": 0.05, "action": "enrich"}}})
    run, full = simulate(scene), simulate(tiny().using(
        {"integrator": integrator, "reducer": "full"}))
    assert run.summary["enriched"]["times"]
    assert measure_errors(full, run).worst["elastic"] < 0.1
    blind = simulate(scene.using({"reducer.error_estimate.action": "warn"}))
    assert measure_errors(full, blind).worst["elastic"] > 0.2


@pytest.mark.full
def test_a_run_with_added_atoms_is_not_resumed(tmp_path: Path) -> None:
    scene = passing("enrich")
    stopped(scene, out=tmp_path, observers=[Strikes(40)])
    with pytest.raises(InputError, match="atoms were added during the run"):
        simulate(scene, out=tmp_path, resume=True)


@pytest.mark.full
@pytest.mark.parametrize("last", [1, 125])
def test_few_estimates_are_equal_in_a_run_that_is_resumed(tmp_path: Path, last: int) -> None:
    """Also between two of them, and whatever the caller says: a run goes on as it began."""
    scene = tiny().using({"time.end": 0.16, "training.end": 0.04, "reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 4}}})
    whole, plain = simulate(scene, estimate=True), simulate(scene)
    for estimate, expected in ((True, whole), (False, plain)):
        out = tmp_path / str(estimate)
        stopped(scene, out=out, observers=[Strikes(last)], estimate=estimate)
        rest = simulate(scene, out=out, resume=True, estimate=not estimate)
        assert rest.error_estimates == expected.error_estimates
        for block in rest.layout:
            assert np.array_equal(rest.block(block.name), plain.block(block.name))
        for name in rest.error_estimates:
            np.testing.assert_allclose(
                rest.error_estimate(name), whole.error_estimate(name), 1e-9)
            assert len(set(whole.error_estimate(name))) >= 4


@pytest.mark.full
@pytest.mark.parametrize("last", [9, 40])
def test_a_run_stopped_before_or_after_it_goes_on_with_equal_digits(
    tmp_path: Path, last: int
) -> None:
    scene, out = passing("fall_back", every=4), tmp_path / "cut"
    whole = simulate(scene)
    assert stopped(scene, out=out, observers=[Strikes(last)]).status is Status.INTERRUPTED
    assert len(open_result(out).times) <= last + 4
    rest = simulate(scene, out=out, resume=True)
    np.testing.assert_array_equal(whole.block("bar.thermal"), rest.block("bar.thermal"))
    np.testing.assert_allclose(  # several estimates at once differ in their last digit
        whole.error_estimate("bar.thermal"), rest.error_estimate("bar.thermal"), 1e-12)
    for key in ("time", "block", "reason", "steps"):
        assert rest.summary["fall_back"][key] == whole.summary["fall_back"][key]


@pytest.mark.full
def test_a_run_that_stopped_goes_on_with_another_action(tmp_path: Path) -> None:
    stopped(passing("stop"), out=tmp_path)
    with pytest.raises(InputError, match="made from another scene"):
        simulate(passing("stop", every=3), out=tmp_path, resume=True)
    run = simulate(passing("fall_back"), out=tmp_path, resume=True)
    assert run.status is Status.DONE and len(run.times) == STEPS + 1
    assert errors(run).worst["thermal"] < 10 * TOLERANCE


@pytest.mark.full
def test_a_kept_model_falls_back_in_memory_and_is_refused_without_its_mesh() -> None:
    model = reduce(passing("fall_back"))
    np.testing.assert_array_equal(
        model.run().block("bar.thermal"), simulate(passing("fall_back")).block("bar.thermal"))
    with pytest.raises(InputError, match="needs the estimate and the assembled model"):
        model.run({"loads.source1.flux.level": 2e7})


@pytest.mark.full
def test_a_step_of_the_reduced_model_that_fails_falls_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coefficients beyond their limit end a run as diverged."""
    scene = passing("fall_back").using({"reducer.error_estimate.tolerance": 1e6})
    monkeypatch.setattr("sparsemor.reducers.trial_bases.GROWTH", 0.1)
    run = simulate(scene)
    assert "ended as diverged in bar.thermal" in run.summary["fall_back"]["reason"]
    assert errors(run).worst["thermal"] < TOLERANCE


@pytest.mark.full
def test_atoms_that_miss_the_training_are_refused_before_the_first_step(tmp_path: Path) -> None:
    scene = tiny().using({"time.end": 0.01, "reducer": {
        "use": "galerkin", "basis": {"use": "modal", "count": 2}}})
    with pytest.raises(InputError) as refused:
        simulate(scene.using({"check_trial_space": "refuse"}), out=tmp_path / "refused")
    assert {f.key for f in refused.value.faults} == {"check_trial_space"}
    assert "2 atoms of bar.elastic cannot represent" in str(refused.value)
    assert not (tmp_path / "refused").exists()
    assert "trial_space" in simulate(scene).summary["note_kinds"]
    assert "trial_space" not in simulate(
        scene.using({"check_trial_space": "off"})).summary["note_kinds"]
    pod = scene.using({"check_trial_space": "refuse", "reducer.basis": {"use": "pod", "count": 6}})
    assert simulate(pod).status is Status.DONE


@pytest.mark.full
def test_selection_from_a_complete_basis_falls_back() -> None:
    """There are no atoms to add; 12 of 68 atoms are selected in each step."""
    estimate = {"every": 2, "tolerance": TOLERANCE, "action": "enrich"}
    scene = passing("enrich").using({"reducer": {
        "use": "sparse", "basis": {"use": "pod", "complete": True}, "residual": "preconditioned",
        "sampler": {"use": "lhs", "required": False}, "budgets": {"*": {"rows": 40, "atoms": 12}},
        "error_estimate": estimate}})
    blind = errors(simulate(scene.using({"reducer.error_estimate.action": "warn"})))
    assert blind.worst["thermal"] > 10 * TOLERANCE
    assert 0.5 < blind.effectivity["bar.thermal"] < 2.0
    run = simulate(scene)
    assert run.summary["enriched"] == {} and run.summary["fall_back"]["steps"] < STEPS
    assert errors(run).worst["thermal"] < TOLERANCE
