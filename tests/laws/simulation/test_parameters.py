"""Parameters of a scene: declaration, values, training over their box, greedy choice, runs outside
the box, and the test at unseen parameters."""

import json
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor import InputError, ReducedModel, load, load_model, parameter_test, reduce, simulate
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.parameters_and_training_points import Parameter, corners, latin_hypercube
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation import training
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.advice.greedy_training_points import estimated_error, greedy_points
from sparsemor.plugins.comparison.error_norms import measure_errors
from sparsemor.plugins.study.plan import StudyPlan

FLUX, ANGLE = "loads.heating.flux", "bodies.bar.pose.angle"
BOX = {"flux": {"key": FLUX, "range": [5.0e5, 2.0e6]}, "angle": {"key": ANGLE, "range": [0.0, 0.5]}}


def boxed(**training: Any) -> Scene:
    return tiny().using({
        "parameters": BOX, ANGLE: 0.1, "training.parameters": training,
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 8}}})


@cache
def model() -> ReducedModel:
    return reduce(boxed(choice="corners"))


def full_order(scene: Scene, **values: float) -> RunResult:
    changes = {f"parameters.{n}": v for n, v in values.items()}
    return simulate(scene.using({**changes, "reducer": "full"}))


FAULTS: list[tuple[dict[str, Any], str, str]] = [
    ({"parameters.flux.key": "loads.cooling.flux"}, "parameters.flux.key", "no number of the"),
    ({"parameters.flux.key": "loads.gravity.g"}, "parameters.flux.key", "no number of the"),
    ({"parameters.flux.key": "title"}, "parameters.flux.key", "no number of the"),
    ({"parameters.flux.key": "training.every"}, "parameters.flux.key", "no number of the"),
    ({"parameters.flux.key": [FLUX, "bodies.bar.thickness"]}, "parameters.flux.key",
     "different values"),
    ({"parameters.flux.key": "time.step"}, "parameters.flux.key", "no number of the"),
    ({"parameters.angle.key": FLUX}, "parameters.angle.key", "is a key of parameter flux already"),
    ({"parameters.flux": "1e6x"}, "parameters.flux", "is a number (got '1e6x')"),
    ({"parameters.flux.range": [2.0, 1.0]}, "parameters.flux.range", "the smaller one"),
    ({"parameters": {"a.b": BOX["flux"]}}, "parameters.a.b", "letters, digits and _"),
    ({"parameters": {}}, "training.parameters", "declares no parameters"),
    ({"training.parameters": {"points": [{"flux": 1.0e6}]}}, "training.parameters.points.0",
     "flux, angle"),
    ({"training.parameters": {"choice": "corners", "samples": 3}}, "training.parameters.samples",
     "has no effect"),
    ({"training.parameters": {"choice": "greedy", "workers": 2}}, "training.parameters.workers",
     "has no effect"),
    ({"parameters.fluks": 1.0e6}, "parameters.fluks", "flux"),
]


@pytest.mark.parametrize("changes,key,words", FAULTS)
def test_faults_are_located(changes: dict[str, Any], key: str, words: str) -> None:
    with pytest.raises(InputError) as error:
        boxed(choice="corners").using(changes)
    assert [f.key for f in error.value.faults] == [key]
    assert words in str(error.value)


@pytest.mark.full
@pytest.mark.parametrize("wrong", [
    {"count": 0}, {"count": 2.5}, {"seed": -1}, {"seed": None}, {"sizes": (0,)}, {"sizes": ("a",)}])
def test_wrong_numbers_of_a_test_are_refused_before_it_runs(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="must be an integer of at least") as error:
        parameter_test(model(), **wrong)
    assert [f.key for f in error.value.faults] == list(wrong)


@pytest.mark.full
def test_values_of_any_kind_of_number_and_nothing_else() -> None:
    plain = model().run(parameters={"flux": 1.25e6})
    same = model().run(parameters={"flux": np.float32(1.25e6)})  # type: ignore[dict-item]
    np.testing.assert_array_equal(same.block("bar.thermal"), plain.block("bar.thermal"))
    anything: Any
    for anything in ([("flux", 1e6)], "flux", {"flux": [1e6]}, {"flux": True}):
        with pytest.raises(InputError, match="give names with values|is a number"):
            model().run(parameters=anything)
    with pytest.raises(InputError, match="must be an integer of at least 1"):
        model().at({}, atoms=0)


def test_a_value_in_the_file_lies_in_its_range_and_a_set_one_may_leave_it() -> None:
    tree = {**tiny().source.tree, "parameters": {"flux": {"key": FLUX, "range": [1.0, 2.0]}}}
    with pytest.raises(InputError, match="outside its range") as error:
        load(tree)
    assert error.value.faults[0].key == FLUX
    assert load(tree, {"parameters.flux": 3.0}).outside_ranges == {"flux": 3.0}


def test_a_value_is_set_at_every_key_and_read_from_plain_data() -> None:
    both = {"speed": {"key": ["bodies.bar.pose.position.0", "bodies.bar.pose.velocity.1"],
                      "range": [0.0, 2.0]}}
    scene = tiny().using({"bodies.bar.pose": {"position": [0, 0], "velocity": [0, 0]}})
    scene = scene.using({"parameters": both}).using({"parameters.speed": 1.5})
    pose = scene.dump()["bodies"]["bar"]["pose"]
    assert pose["position"] == [1.5, 0.0] and pose["velocity"] == [0.0, 1.5]
    assert load(scene.dump()).point == {"speed": 1.5}
    assert load(boxed(choice="corners").dump()).point == {"flux": 1.0e6, "angle": 0.1}


def test_samples_of_a_box() -> None:
    box = {n: Parameter.model_validate(p) for n, p in BOX.items()}
    points = latin_hypercube(box, 7, 3)
    assert points == latin_hypercube(box, 7, 3) != latin_hypercube(box, 7, 4)
    for name, p in box.items():
        low, high = p.range
        shares = [(point[name] - low) / (high - low) for point in points]
        assert sorted(int(7 * s) for s in shares) == list(range(7)), "one value in each part"
    assert {tuple(point.values()) for point in corners(box)} == {
        (f, a) for f in (5.0e5, 2.0e6) for a in (0.0, 0.5)}


def test_a_study_over_a_parameter_has_references_of_its_own(tmp_path: Path) -> None:
    plan = StudyPlan.read({"format": 1, "scene": _written(tmp_path), "grid": {
        "parameters.flux": [6.0e5, 7.0e5]}})
    assert len({run.reference for run in plan.runs}) == 2
    assert len({run.training for run in plan.runs}) == 1, "the box is the same"


def _written(folder: Path) -> str:
    (folder / "bar.yaml").write_text(json.dumps(boxed(choice="corners").dump()))
    return str(folder / "bar.yaml")


@pytest.mark.full
def test_a_model_is_accurate_at_unseen_parameters_of_its_box() -> None:
    for values in ({"flux": 1.7e6}, {"flux": 6.0e5, "angle": 0.37}):
        run = model().run(parameters=values)
        errors = measure_errors(full_order(model().scene, **values), run).worst
        assert max(errors.values()) < 1e-4
        assert set(run.summary["note_kinds"]) <= {"stiff_in_bending", "time_error"}  # of the scene
    poor = reduce(boxed(points=[{"flux": 1.0e6, "angle": 0.0}]))
    assert max(measure_errors(full_order(poor.scene, angle=0.5), poor.run(
        parameters={"angle": 0.5})).worst.values()) > 1e-3, "one training run does not do"


@pytest.mark.full
def test_outside_the_box_a_run_warns(tmp_path: Path) -> None:
    kinds = model().run(parameters={"flux": 3.0e6}).summary["note_kinds"]
    assert "outside_parameters" in kinds
    assert "outside_parameters" not in model().run().summary["note_kinds"]
    kinds = model().run(parameters={"angle": -0.2}).summary["note_kinds"]
    assert "outside_parameters" in kinds
    full = full_order(model().scene, flux=3.0e6)
    assert "outside_parameters" not in full.summary["note_kinds"]


@pytest.mark.full
def test_a_file_keeps_the_parameters(tmp_path: Path) -> None:
    model().save(tmp_path / "bar.model")
    kept = load_model(tmp_path / "bar.model")
    assert kept.scene.parameters == model().scene.parameters
    a, b = (m.run(parameters={"flux": 6.0e5}).coefficients("bar.thermal")
            for m in (kept, model()))
    np.testing.assert_array_equal(a, b)
    with pytest.raises(InputError, match="projected again in a model from memory only") as error:
        kept.run(parameters={"angle": 0.3})
    assert error.value.faults[0].key == ANGLE


@pytest.mark.full
def test_greedy_adds_runs_until_the_estimate_is_small(tmp_path: Path) -> None:
    store = Cache(tmp_path / "cache")
    short = {"parameters": {"angle": BOX["angle"]}, "time.end": 0.02}
    points = {}
    for tolerance in (10.0, 1e-3):
        scene = boxed(choice="greedy", samples=4, candidates=1, tolerance=tolerance).using(short)
        made = reduce(scene, cache=store)
        points[tolerance], notes = greedy_points(scene, Products(store), unused)
        assert not notes
        assert points[tolerance][0] == {"angle": 0.25}, "the centre"
    assert len(points[10.0]) == 1 < len(points[1e-3]) < 4
    assert measure_errors(full_order(scene), made.run()).worst["elastic"] < 1e-2
    few = reduce(scene.using({"training.parameters.samples": 2}), cache=store).run()
    assert "training_tolerance" in few.summary["note_kinds"], "not tried after the last run"
    absent: Any = None
    with pytest.raises(InputError, match="greedy needs estimated errors"):
        estimated_error(scene, absent, absent, absent)


def unused(*of: object) -> NoReturn:
    raise AssertionError("the choice is in the cache")


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["deim", "ecsw", "sparse"])
def test_every_reducer_trains_over_a_box(reducer: str) -> None:
    scene = boxed(choice="corners").using({
        "reducer": {"use": reducer, "basis": {"use": "pod", "count": 8}}})
    run = reduce(scene).run(parameters={"flux": 6.0e5, "angle": 0.3})
    errors = measure_errors(full_order(scene, flux=6.0e5, angle=0.3), run).worst
    assert max(errors.values()) < 1e-3


@pytest.mark.full
def test_errors_at_random_parameters_by_size() -> None:
    found = parameter_test(model(), 3, sizes=(2,))
    assert len(found.rows) == 6 and len({row["flux"] for row in found.rows}) == 3
    assert {row["status"] for row in found.rows} == {"done"}
    whole, leading = ([r for r in found.rows if r["unknowns"] == n] for n in (21, 9))
    assert len(whole) == len(leading) == 3
    for measure, worst in found.worst.items():
        assert worst == max(r[f"error_{measure}"] for r in whole)
    assert found.worst["elastic"] < 1e-3 < max(r["error_elastic"] for r in leading)
    assert str(found).startswith("worst error over the runs")
    assert found.to_csv().count("\n") == 7 and model().offline_seconds > 0.0
    again = parameter_test(model(), 3)
    assert [r["error_elastic"] for r in again.rows] == [r["error_elastic"] for r in whole]


@pytest.mark.full
def test_training_runs_in_other_processes_have_the_same_digits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone, seen = Cache(tmp_path / "alone"), Cache(tmp_path / "at_once")
    one = reduce(boxed(choice="corners"), cache=alone)
    with monkeypatch.context() as here:
        here.setattr(training, "train", lambda *a: pytest.fail("trained in this process"))
        two = reduce(boxed(choice="corners", workers=2), cache=seen)
    assert sorted(e.key for e in alone.entries() if e.kind == "training") == sorted(
        e.key for e in seen.entries() if e.kind == "training")
    for b in one.run().layout:
        assert np.array_equal(one.run().block(b.name), two.run().block(b.name)), b.name
    point = {"flux": 5.0e5, "angle": 0.0}
    bad = boxed(points=[point, {**point, "flux": 1e300}], workers=2)
    with pytest.raises(SolveFailed, match="training run"):
        reduce(bad, cache=seen)
