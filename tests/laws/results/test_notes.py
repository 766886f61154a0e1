"""Notes: what is a warning, what is information, and that only warnings count as such."""

from pathlib import Path

import pytest

from small_scenes import tiny
from sparsemor import load, simulate
from sparsemor.core.notes import Level, Note, information, kinds, sentences
from sparsemor.plugins.command_line.folded_notes import folded
from sparsemor.plugins.stability.survey import unsampled

SLIDER = "tests/scenes/small_slider.yaml"
INSIDE = {"reducer": "galerkin", "rigid_stage": None, "contacts.sole.surfaces": "deformed",
          "time.end": 1.5e-5, "training.end": 1.5e-5}


def test_levels_and_kinds_are_told_apart() -> None:
    notes = (Note("a", "x"), information("b", "y"), Note("a", "x"), Note("c"))
    assert sentences(notes, Level.WARNING) == ["a", "c"]
    assert sentences(notes, Level.INFORMATION) == ["b"]
    assert kinds(notes) == ["x"]


@pytest.mark.full
def test_how_a_step_is_solved_is_information_and_no_unsampled_load(here: object) -> None:
    scene = load(str(Path(__file__).parents[3] / SLIDER), INSIDE)
    summary = simulate(scene).summary
    assert set(summary["note_kinds"]) <= {"stiff_in_bending"}
    assert any("couples blocks" in text for text in summary["information"])


@pytest.mark.full
def test_a_basis_without_a_field_to_reduce_is_said_to_have_no_effect(here: object) -> None:
    rigid = {"bodies.bar.fields": [], "bodies.bar.reference": None, "loads.heating": None,
             "time.end": 2e-3, "reducer": {"use": "sparse", "basis": {"use": "pod", "count": 3},
                                           "solver": {"use": "omp"}}}
    assert simulate(tiny().using(rigid)).summary["notes"] == [
        "reducer.basis has no effect: no body of the scene has a field that is reduced"]


def test_only_unsampled_loads_are_counted_as_such() -> None:
    class Solver:
        notes = (Note("the rows miss a load", "unsampled"), Note("another warning", "other"),
                 information("how a step is solved"))

    assert unsampled(Solver()) == 1


def test_one_fact_about_several_runs_and_blocks_is_one_line() -> None:
    far = "{} left its range in {} % of the steps, by up to {} of its change: train longer"
    stiff = "the elements of {0} are too stiff by {1} %: set bodies.{0}.order: 2"
    runs = {
        "galerkin": [far.format("rod.elastic", 47, 0.94), far.format("rod.thermal", 45, 1e-3),
                     stiff.format("rod", 5)],
        "sparse": [far.format("rod.elastic", 40, -2.5), far.format("rod.thermal", 1, 3),
                   "another fact"]}
    assert folded(runs, ["rod", "crank"]) == [
        f"galerkin, sparse: {runs['galerkin'][0]} (also rod.thermal)",
        f"galerkin: {runs['galerkin'][2]}", "sparse: another fact"]
    one = {"": [stiff.format("rod", 5.5), stiff.format("crank", 12), "3 atoms"]}
    assert folded(one, ["rod", "crank"]) == [f"{one[''][0]} (also crank)", "3 atoms"]
    lists = {"a": ["the error is about rod.elastic 5 %, crank.elastic 3.7 % of it"],
             "b": ["the error is about crank.elastic 5 % of it", "4 atoms"]}
    assert folded(lists, ["rod", "crank"]) == [f"a, b: {lists['a'][0]}", "b: 4 atoms"]
    apart = {"a": [far.format("rod.elastic", 1, 1)], "b": [far.format("crank.thermal", 1, 1)]}
    assert folded(apart, ["rod", "crank"])[0].endswith("train longer (also b: crank.thermal)")
    assert folded({"": []}, []) == folded({}, ["rod"]) == []
