"""Scene files made to break the reader: each is refused, at its place, before it costs much."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from sparsemor.core.errors import InputError
from sparsemor.core.scene.expressions import Expression
from sparsemor.core.scene.overrides import parse_settings
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.scene.yaml_reader import MOST_BYTES
from sparsemor.core.simulation.memory.estimate import room_for_result
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model
from tiers import quick

SCENES = Path(__file__).parents[1] / "scenes"
TINY = SCENES / "tiny.yaml"


def refused(overrides: dict[str, Any], scene: Path = TINY) -> list[str]:
    """The lines of a scene that `load` or `validate` refuses."""
    loaded: Scene | None = None
    with pytest.raises(InputError) as caught:
        loaded = load(scene, overrides)
        checked_model(loaded)
    return str(caught.value).splitlines() if loaded is None else loaded.locate(caught.value)


def read(folder: Path, text: str) -> str:
    """What is wrong with a scene file of this text."""
    file = folder / "scene.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(file)
    return str(caught.value).replace(f"{file}:", "").partition("\n")[0]


NESTED = {
    "lists": "[" * 3000, "mappings": "{a: " * 3000, "keys": "? " * 3000, "items": "- " * 3000,
    "indentation": "\n".join(" " * n + "a:" for n in range(1200)),
}


@pytest.mark.parametrize("kind", quick(NESTED, "mappings", "keys", "items", "indentation"))
def test_a_file_nested_too_deep_is_refused_where_it_passes_the_limit(
    tmp_path: Path, kind: str
) -> None:
    assert "nested deeper than 64 levels" in read(tmp_path, NESTED[kind])


@pytest.mark.full
def test_a_setting_nested_too_deep_is_refused() -> None:
    with pytest.raises(InputError, match="nested deeper than 64 levels"):
        parse_settings(["seed=" + "[" * 2000])


def test_a_file_of_too_many_keys_is_refused_at_the_first_too_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sparsemor.core.scene.yaml_reader.MOST_KEYS", 200)
    text = "".join(f"k{n}: 1\n" for n in range(205))
    assert read(tmp_path, text) == "201:1: this is not YAML: more than 200 keys"


def test_a_file_too_large_is_refused_unread(tmp_path: Path) -> None:
    assert "1:1: a scene file has at most 1.5 MB" in read(tmp_path, "\n" * (MOST_BYTES + 1))


@pytest.mark.parametrize("text, words", [
    ("0x" + "F" * 6000, "must be a finite number"), ("1" + "0" * 400, "must be a finite number"),
    ("9" * 6000, "cannot be read as int")])
def test_integers_beyond_all_numbers_are_refused_in_a_short_line(text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_settings([f"seed={text}"])
    assert words in str(caught.value) and len(str(caught.value)) < 150


def test_an_integer_from_python_is_refused_too() -> None:
    assert "must be finite (got an integer of 24000 bits)" in refused({"seed": 16**6000 - 1})[0]


@pytest.mark.parametrize("text", ["~" * 1900 + "x", "x" + ".a" * 900, "x" + "()" * 900])
def test_refusing_an_expression_does_not_recurse_through_it(text: str) -> None:
    with pytest.raises(InputError, match="not allowed"):
        Expression.parse(text, "condition")


def test_a_full_width_letter_is_no_coordinate() -> None:
    with pytest.raises(InputError, match="not an ASCII character"):
        Expression.parse("\uff58 > 1", "condition")


@pytest.mark.parametrize("value", [True, 1.0])
def test_the_format_is_the_integer_1(value: object) -> None:
    assert "the version of the format is the integer 1" in refused({"format": value})[0]


@pytest.mark.full
def test_a_driven_rotation_needs_the_axis_of_a_spinning_frame() -> None:
    lines = refused({"joints.drive.axis": [0, 1, 0]}, SCENES / "small_brake.yaml")
    assert lines == ["--set joints.drive.axis: in the rigid stage: the body turns about the z axis "
                     "alone, and about [0.0, 1.0, 0.0] it cannot: the axis must be [0, 0, 1]; or "
                     "give the body a floating frame"]


@pytest.mark.parametrize("key", ["reducer", "reducer.use", "training.every"])
def test_training_has_no_reducer_to_choose(key: str) -> None:
    value = 2 if key == "training.every" else "galerkin"
    lines = refused({"reducer": "galerkin", "training.overrides": {key: value}})
    assert len(lines) == 1 and f"{key} has no effect on the training run" in lines[0]


@pytest.mark.full
def test_training_on_another_mesh_is_refused_before_it_runs() -> None:
    lines = refused({"reducer": "galerkin",
                     "training.overrides": {"bodies.bar.mesh.divisions": [4, 2]}})
    assert lines[0] == ("--set training.overrides: the training run has 27 unknowns of "
                        "bar.elastic, and the run 51: change neither mesh, fields nor reference "
                        "there")


WHOLE = {"bodies.bar.sets.whole": {"where": "x > -1"}}


def test_a_body_held_at_every_point_is_refused() -> None:
    assert "bodies.bar.reference: fixes all 54 displacements of the 27 points" in refused(
        {**WHOLE, "bodies.bar.reference": {"clamp": "whole"}})[0]


def test_a_body_with_every_temperature_prescribed_is_refused() -> None:
    hot = {"use": "prescribed_temperature", "on": ["bar:whole"], "temperature": 300}
    heat_alone = {"bodies.bar.fields": ["thermal"], "bodies.bar.reference": None}
    assert any("the temperature of every node of 'bar' is prescribed" in line
               for line in refused({**WHOLE, **heat_alone, "joints.hot": hot}))


GRIDS: dict[str, tuple[dict[str, Any], str, str]] = {
    "run": ({"time.end": 1e9, "time.step": 1e-3}, "time.step", "1e+12 steps"),
    "beyond all numbers": ({"time.end": 1e308, "time.step": 1e-10}, "time.step", "more than 1e300"),
    "training": ({"training.end": 1e9, "training.overrides": {"time.step": 1e-3}}, "training.end",
                 "1e+12 steps"),
    "training's step": ({"training.overrides": {"time.step": 1e-14}}, "training.overrides",
                        "4e+12 steps"),
    "rigid stage": ({"rigid_stage": {"overrides": {"time.step": 1e-14}}}, "rigid_stage",
                    "4e+12 steps"),
}


@pytest.mark.parametrize("name", GRIDS)
def test_a_time_grid_without_end_is_refused(name: str) -> None:
    overrides, key, words = GRIDS[name]
    lines = refused(overrides)
    assert len(lines) == 1 and key in lines[0] and words in lines[0]


def test_a_time_grid_is_refused_with_its_memory_and_time() -> None:
    line, = refused({"time.end": 1e9, "time.step": 1e-3})
    assert "289 days at the least" in line and "60000 GB of memory" in line


@pytest.mark.full
def test_a_result_too_large_for_the_disk_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """87 numbers a stored step: 696 MB of a million steps, on a disk with 1 GB."""
    monkeypatch.setattr("shutil.disk_usage", lambda place: SimpleNamespace(free=10**9))
    model, there = checked_model(load(TINY)), tmp_path / "not" / "there"
    room_for_result(load(TINY, {"time.end": 1e3}), model, there)
    long = {"time.end": 2e3}
    with pytest.raises(InputError) as caught:
        room_for_result(load(TINY, long), model, there)
    fault, = caught.value.faults
    assert fault.key == "time.step" and "which has 1 GB left" in fault.message
    assert "1.4 GB on the disk (2e+06 stored steps of 87 numbers)" in fault.message
    assert "50 seconds at the least" in fault.message
    room_for_result(load(TINY, {**long, "output.every": 2}), model, there)
    watched = {"probes": {"end": {"body": "bar", "at": [0.5, 0.0]}}}
    with pytest.raises(InputError, match="stored steps of 92 numbers"):  # x, u and T more
        room_for_result(load(TINY, {**long, **watched}),
                        checked_model(load(TINY, watched)), there)


def test_a_run_whose_result_has_no_room_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda place: SimpleNamespace(free=1000))
    with pytest.raises(InputError, match="on the disk"):
        simulate(load(TINY), out=tmp_path / "out")
    assert not list(tmp_path.iterdir())
