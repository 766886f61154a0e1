"""A reducer's name, and an option that it lacks: one meaning in --set, compare and studies."""

import json
from typing import Any

import pytest

from sparsemor import InputError, load
from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.scene.source import Source
from sparsemor.plugins.comparison.command import variants
from sparsemor.plugins.study.plan import StudyPlan

SCENES = ("slider_plate", "brake_disk", "double_pendulum")


def in_study(scene: str, **axes: list[Any]) -> list[dict[str, Any]]:
    """Reducer of each run of a study of these axes."""
    plan = StudyPlan.read({"scene": scene, "grid": axes})
    return [build(Source.of_tree(dict(run.scene["tree"]))).dump()["reducer"]
            for run in plan.runs if run.scene is not None]


def reducer(scene: Scene) -> dict[str, Any]:
    return dict(scene.dump()["reducer"])


@pytest.mark.full
@pytest.mark.parametrize("name", SCENES)
def test_one_name_means_one_model(name: str) -> None:
    scene = load(name)
    words = ["galerkin", "sparse", "deim"]
    set_ = [reducer(scene.using({"reducer": word})) for word in words]
    assert set_ == [reducer(scene.using({"reducer.use": word})) for word in words]
    assert set_ == [reducer(s) for s in variants(scene, words).values()]
    if name != "double_pendulum":  # planning assembles nothing, but reads many plugins
        assert set_ == in_study(name, reducer=words)
    own = reducer(scene)
    for made in set_:
        assert (made["basis"], made["bases"]) == (own["basis"], own["bases"])
        assert made["use"] != own["use"] or made == own


def test_a_mapping_has_the_defaults_of_its_reducer() -> None:
    scene = load("brake_disk", {"reducer": {"use": "galerkin"}})
    assert reducer(scene)["basis"]["use"] == "pod" and not reducer(scene)["bases"]
    assert not scene.notes


def test_the_same_name_changes_nothing_and_says_so() -> None:
    scene = load("slider_plate", {"reducer": "sparse"})
    assert reducer(scene) == reducer(load("slider_plate"))
    (note,) = scene.notes
    assert note.kind == "no_effect" and "whose options stay" in note.text


@pytest.mark.full
@pytest.mark.parametrize("option", ["sampler", "solver", "preconditioner"])
def test_an_option_that_the_reducer_lacks_changes_it(option: str) -> None:
    value = {"sampler": "deim", "solver": "omp", "preconditioner": "untf"}[option]
    scene, own = load("brake_disk", {f"reducer.{option}": value}), reducer(load("brake_disk"))
    made = reducer(scene)
    assert made["use"] == "sparse" and made[option]["use"] == value
    assert (made["basis"], made["bases"]) == (own["basis"], own["bases"])
    (note,) = scene.notes
    assert note.kind == "reducer_changed"
    assert f"galerkin, the reducer of the scene, has no {option}" in note.text
    assert not scene.using({"reducer": {"use": "full"}}).notes, "of a reducer that is replaced"
    assert [json.dumps(r) for r in in_study("brake_disk", **{f"reducer.{option}": [value]})] == [
        json.dumps(made)]


@pytest.mark.parametrize("changes", [
    {"reducer": "galerkin", "reducer.sampler": "deim"},  # said in so many words
    {"reducer.sampelr": "deim"},  # no reducer has it
    {"reducer": {"use": "full"}, "reducer.sampler": "deim"},
])
def test_what_contradicts_itself_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="no such option"):
        load("brake_disk", changes)


def test_an_option_next_to_a_name_applies_to_that_reducer() -> None:
    made = reducer(load("brake_disk", {"reducer": "sparse", "reducer.sampler": "deim"}))
    assert made["sampler"]["use"] == "deim" and made["basis"]["use"] == "impulse"
