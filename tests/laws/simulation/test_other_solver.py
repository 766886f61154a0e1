"""Where steps are not solved with the linear solver that the scene names, the run says so."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load
from sparsemor.core import ReducedProblem
from sparsemor.core.model.assembly import assemble
from sparsemor.core.notes import Level, Note
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline

SCENES = Path(__file__).parents[2] / "scenes"
RADIATION = {"use": "radiation", "on": ["bar:top"], "emissivity": 0.5, "surroundings": 300.0}


def notes(scene: Scene) -> list[Note]:
    model = assemble(scene)
    solver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, Offline.from_snapshots(model, {}),
        np.random.default_rng(0)))
    return [n for n in solver.notes if n.kind == "linear_solver"]


def tiny(**changes: Any) -> Scene:
    return load(SCENES / "tiny.yaml", {"reducer": "full", **changes})


def contact(**changes: Any) -> Scene:
    """The contact inside the step: all unknowns are solved together."""
    return load(SCENES / "small_slider.yaml", {
        "reducer": "full", "rigid_stage": None, **changes})


@pytest.mark.full
@pytest.mark.parametrize("solver", ["auto", "splu", {"use": "splu", "ordering": "columns"}])
def test_nothing_is_said_of_the_solver_that_serves(solver: Any) -> None:
    assert notes(contact(linear_solver=solver)) == []
    assert notes(tiny(linear_solver=solver, **{"loads.hot": RADIATION})) == []


def test_nothing_is_said_where_the_chosen_solver_serves() -> None:
    assert notes(tiny(linear_solver="cg")) == []


def test_contact_in_the_step_names_the_solver_that_it_leaves_aside() -> None:
    (note,) = notes(contact(linear_solvers={"plate.*": "cg"}))
    assert note.level is Level.INFORMATION
    assert "solved with splu, not with cg for plate.elastic, cg for plate.thermal" in note.text
    assert "sole couples blocks inside the step" in note.text


def test_the_textbook_method_names_the_solver_that_it_leaves_aside() -> None:
    (note,) = notes(tiny(linear_solver="cg", reducer={"use": "full", "method": "newton"}))
    assert "method: newton" in note.text and "cg for bar.elastic" in note.text


def test_radiation_names_the_solver_that_its_newton_steps_leave_aside() -> None:
    (note,) = notes(tiny(linear_solver="cg", **{"loads.hot": RADIATION}))
    assert note.level is Level.INFORMATION
    assert "cg solves the constant part of bar.thermal" in note.text
    assert "Newton steps are solved with splu" in note.text
