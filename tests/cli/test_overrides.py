"""Overrides act on the tree as written."""

import pickle
from pathlib import Path

import pytest

from sparsemor.core.errors import InputError
from sparsemor.core.scene.overrides import parse_settings
from sparsemor.core.scene.scene import Scene, load
from toy_scene import HEAD

TEXT = HEAD + """\
reducer:
  use: tuned
  sampler: {use: grid, mix: 0.25}
  budgets: {"*.elastic": 5}
training:
  overrides:
    bodies.a.mass: 2
"""

pytestmark = pytest.mark.usefixtures("toys")


@pytest.fixture
def scene(tmp_path, monkeypatch) -> Scene:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(TEXT)
    return load("scene.yaml")


def complaint(scene: Scene, overrides: dict[str, object]) -> list[str]:
    with pytest.raises(InputError) as caught:
        scene.using(overrides)
    return str(caught.value).splitlines()


def test_a_subtree_is_replaced(scene):
    assert scene.using({"reducer": "direct"}).dump()["reducer"] == {"use": "direct"}


def test_null_removes_an_entry_of_a_table(scene):
    made = scene.using({"bodies.b": {"use": "ball", "mass": 3}}).using({"bodies.b": None})
    assert list(made.dump()["bodies"]) == list(scene.dump()["bodies"])
    (line,) = complaint(scene, {"loads.nobody": None})
    assert "loads.nobody" in line and "nothing of this name to remove" in line


def test_the_scene_itself_stays(scene):
    before = scene.dump()
    scene.using({"bodies.a.mass": 7, "reducer.budgets.*.elastic": 9})
    assert scene.dump() == before


def test_a_slot_is_replaced(scene):
    sampler = scene.using({"reducer.sampler": "dice"}).reducer.sampler
    assert sampler.model_dump() == {"sides": 6}


def test_a_new_use_drops_the_old_options(scene):
    assert scene.using({"reducer.sampler.use": "dice"}).reducer.sampler.sides == 6


def test_the_same_use_keeps_the_options(scene):
    assert scene.using({"reducer.sampler.use": "grid"}).reducer.sampler.mix == 0.25


def test_use_is_applied_before_its_options_in_any_order(scene):
    made = scene.using({"reducer.sampler.sides": 4, "reducer.sampler.use": "dice"})
    assert made.reducer.sampler.sides == 4


def test_an_option_of_a_plugin_given_by_name(scene):
    assert scene.using({"integrator.rho": 0.5}).integrator.rho == 0.5


def test_an_option_of_a_default_that_is_not_written(scene):
    made = scene.using({"reducer": "tuned", "reducer.sampler.mix": 0.125})
    assert made.reducer.sampler.mix == 0.125


def test_keys_with_dots(scene):
    assert scene.using({"reducer.budgets.*.elastic": 7}).reducer.budgets == {"*.elastic": 7}
    made = scene.using({'reducer.budgets."*.thermal"': 2})
    assert made.reducer.budgets == {"*.elastic": 5, "*.thermal": 2}


def test_new_entries_and_list_items(scene):
    made = scene.using({"loads.wind": {"use": "push", "force": 3}, "reducer.queue": ["grid"]})
    assert made.loads["wind"].force == 3.0
    assert made.using({"reducer.queue.0.mix": 0.5}).reducer.queue[0].mix == 0.5
    assert complaint(made, {"reducer.queue.4": "grid"}) == [
        "--set reducer.queue.4: the list has items 0 to 0 (got 4)"]


def test_an_instance(scene):
    dice = type(scene.using({"reducer.sampler": "dice"}).reducer.sampler)(sides=2)
    made = scene.using({"reducer.sampler": dice})
    assert made.dump()["reducer"]["sampler"] == {"use": "dice", "sides": 2}


def test_faults_name_the_override(scene):
    assert complaint(scene, {"time.step": 0, "reducer.sampler.mix": 2}) == [
        "--set reducer.sampler.mix: Input should be less than or equal to 1 (got 2)",
        "--set time.step: Input should be greater than 0 (got 0)"]
    (line,) = complaint(scene, {"reducer.sampler.use": "dyce"})
    assert line.startswith("--set reducer.sampler.use: ") and "did you mean dice?" in line
    (line,) = complaint(scene, {"bodies.b": {"use": "ball"}})
    assert line == "--set bodies.b: bodies.b.mass: is missing, and has no default"
    (line,) = complaint(scene, {"reducer.smpler": 1})
    assert line.startswith("--set reducer.smpler: no such option: did you mean sampler?")


def test_what_cannot_be_set(scene):
    assert complaint(scene, {"bodies.a.mass.unit": "kg"}) == [
        "--set bodies.a.mass.unit: bodies.a.mass has no options to set (it is 1)"]
    (line,) = complaint(scene, {"time.end": float("nan")})
    assert line == "--set time.end: must be finite (got NaN)"
    (line,) = complaint(scene, {"seed.x": 1})
    assert line.startswith("--set seed.x: seed: Input should be a valid integer")


def test_a_scene_built_in_python_takes_overrides(scene):
    made = Scene.model_validate(scene.dump())
    assert made.using({"reducer.sampler.use": "dice"}).reducer.sampler.sides == 6
    with pytest.raises(InputError, match="--set seed: Input should be greater"):
        made.using({"seed": -1})


def test_overrides_add_up_and_survive_pickling(scene):
    made = scene.using({"reducer.sampler": "dice"}).using({"reducer.sampler.sides": 9})
    again = pickle.loads(pickle.dumps(made))
    assert again.dump() == made.dump()
    assert again.locate(InputError("odd", "reducer.sampler.sides")) == [
        "--set reducer.sampler.sides: odd"]


def test_the_training_scene_does_not_depend_on_the_reducer(scene):
    training = scene.using({"training.end": 0.5}).for_training()
    other = scene.using({"training.end": 0.5, "reducer": "second"}).for_training()
    assert training.digest() == other.digest()
    assert training.time.end == 0.5
    assert training.bodies["a"].mass == 2.0
    assert training.dump()["reducer"]["use"] == "full"
    assert training.training.overrides == {}


def test_faults_of_training_overrides_are_placed_in_the_file(scene):
    Path("bad.yaml").write_text(TEXT.replace("mass: 2", "mass: -2"))
    with pytest.raises(InputError) as caught:
        load("bad.yaml").for_training()
    assert str(caught.value) == ("bad.yaml:12:5: training.overrides.bodies.a.mass: "
                                 "Input should be greater than 0 (got -2)")


def test_training_must_hold_a_step(scene):
    (line,) = complaint(scene, {"training.end": 1e-4})
    assert line == "--set training.end: must be at least time.step (got 0.0001)"


def test_settings_are_yaml():
    assert parse_settings(["time.end=1e-3", "reducer={use: pod, energy: 0.9}", "on=[a, 1]",
                           "title=a=b"]) == {
        "time.end": 1e-3, "reducer": {"use": "pod", "energy": 0.9}, "on": ["a", 1], "title": "a=b"}
    with pytest.raises(InputError) as caught:
        parse_settings(["time.end", "a=[1", "b=.nan"])
    first, second, third = caught.value.faults
    assert "key=value" in first.message
    assert second.key == "a" and "flow sequence" in second.message
    assert (third.key, third.message) == ("b", "must be a finite number (got .nan)")
