"""Notes: what is a warning, what is information, and that only warnings count as such."""

from pathlib import Path

import pytest

from small_scenes import tiny
from sparsemor import load, simulate
from sparsemor.core.notes import Level, Note, information, kinds, sentences
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
