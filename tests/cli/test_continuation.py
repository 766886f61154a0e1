"""A run that has ended goes on to a later end, as one that had it from the start."""

from pathlib import Path
from typing import Any

import pytest

from sparsemor import InputError, Status, load, open_result, simulate
from tests.cli.test_resume import CASES, SWING, assert_same_bits

pytestmark = pytest.mark.full
SLIDER = Path(__file__).parents[1] / "scenes" / "small_slider.yaml"
GALERKIN = {"use": "galerkin", "basis": {"use": "pod", "count": 6}}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARSEMOR_CACHE", str(tmp_path / "cache"))


def continued(name: Path, changes: dict[str, Any], *ends: float) -> None:
    """A run to each of these ends in turn equals one to the last of them."""
    for end in ends:
        on = simulate(load(name, {**changes, "time.end": end}), out="on", resume=end != ends[0])
    whole = simulate(load(name, {**changes, "time.end": ends[-1]}), out="whole")
    assert_same_bits(on, whole)
    assert on.scene == whole.scene and on.attributes["steps_planned"] == whole.summary["steps"]


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name != "sparse, selecting, rows always new"))
    for name, (changes, _) in CASES.items() if "time.control" not in changes])
def test_an_ended_run_continues(name: str) -> None:
    continued(SWING, {"training.end": 0.06, **CASES[name][0]}, 0.025, 0.06)


def test_along_a_pre_simulation_it_continues_twice() -> None:
    step = load(SLIDER).time.step
    continued(SLIDER, {"reducer": GALERKIN, "training.end": 4 * step}, 4 * step, 7 * step,
              11 * step)
    assert len(open_result("on").stage().times) == 12


def test_a_later_end_that_changes_the_model_is_refused() -> None:
    short = load(SWING, {"time.end": 0.02, "training.end": None})
    simulate(short, out="out")
    with pytest.raises(InputError, match="trained to 0.02 s.* add --set training.end=0.02"):
        simulate(short.using({"time.end": 0.04}), out="out", resume=True)
    kept = simulate(short.using({"time.end": 0.04, "training.end": 0.02}), out="out", resume=True)
    assert kept.summary["steps"] == 40
    with pytest.raises(InputError, match="and a run is continued to a later one"):
        simulate(short, out="out", resume=True)


def test_steps_that_depend_on_the_end_are_not_continued() -> None:
    controlled = load(SWING, {"reducer": "full", "time": {
        "step": 1e-3, "end": 0.002, "control": {"tolerance": 0.1}}})
    simulate(controlled, out="out")
    with pytest.raises(InputError, match="the error that time.control allows in a step"):
        simulate(controlled.using({"time.end": 0.003}), out="out", resume=True)


def test_atoms_that_depend_on_the_end_are_refused() -> None:
    """Those that are computed from the table of a load that moves."""
    step = load(SLIDER).time.step
    moving = load(SLIDER, {
        "time.end": 4 * step, "training.end": 4 * step, "check_stability": "off",
        "reducer": {"use": "galerkin", "basis": {"use": "impulse", "count": 8}}})
    simulate(moving, out="out")
    with pytest.raises(InputError, match="the reduced model or its loads depend on time.end"):
        simulate(moving.using({"time.end": 8 * step}), out="out", resume=True)
    assert open_result("out").status is Status.DONE


def test_an_estimate_with_loads_of_a_pre_simulation_is_refused() -> None:
    step = load(SLIDER).time.step
    short = load(SLIDER, {"time.end": 4 * step, "training.end": 4 * step,
                          "check_stability": "off", "reducer": {**GALERKIN, "error_estimate": 1}})
    simulate(short, out="out")
    with pytest.raises(InputError, match="loads from the whole rigid-body pre-simulation"):
        simulate(short.using({"time.end": 8 * step}), out="out", resume=True)
    assert open_result("out").status is Status.DONE
