"""Residual of selected atoms over all rows, against that of all atoms: numbers and notes."""

from typing import Any

import numpy as np
import pytest

from small_scenes import coarse_pendulum, tiny
from sparsemor import compare, simulate
from sparsemor.core import Dictionary, State, StepFactors
from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Level
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.plugins.checks.selected_atoms import (
    RATIO,
    check_selection,
)
from tiny_scene import full, prepared, snapshots

NAME = "bar.thermal"


def orthogonal_atoms() -> Dictionary:
    U = np.linalg.svd(snapshots()[NAME], full_matrices=False)[0][:, :4]
    return Dictionary(np.ascontiguousarray(U), np.zeros(len(U)), ("",) * 4)


def beside(inside: float, outside: float) -> tuple[State, float, FloatArray]:
    """A state of the full-order run moved within the atoms and across them, orthogonal in D: its
    residual is D (A d + w). Returns it, the ratio that follows, and the part within."""
    scene, run = tiny(), full()
    model, d = run.model, orthogonal_atoms()
    factors = scene.integrator.rules(scene.time.step).factors
    data = model.block_data(NAME, step=StepFactors(scene.time.step, *factors))
    D, A = data.operator, d.atoms
    w = np.random.default_rng(0).standard_normal(len(A))
    w -= A @ np.linalg.solve(A.T @ (D @ A), A.T @ (D @ w))
    part, rest = inside * A[:, 0], outside * w
    last, at = run.end, model.layout[NAME]
    x, v = last.x.copy(), last.v.copy()
    x[at] += part + rest
    v[at] += factors[2] * (part + rest)
    ratio = np.sqrt((part @ (D @ part) + rest @ (D @ rest)) / (rest @ (D @ rest)))
    return State(last.t, x, v, last.a, last.memory), float(ratio), np.asarray(D @ part)


def checked(state: State, dictionary: Dictionary, rows: int = 0) -> Any:
    """Notes where three of four atoms are selected, or all are used with so many rows."""
    scene, support = tiny(), {NAME: np.array([False, True, True, True])}
    step = StepFactors(scene.time.step, *scene.integrator.rules(scene.time.step).factors)
    found = check_selection(full().model, {NAME: dictionary}, step, [
        (state, {} if rows else support)], {NAME: rows} if rows else {})
    return [note for s in found if (note := s.note()) is not None]


@pytest.mark.parametrize(("inside", "outside", "noted", "cause"), [
    (5.0, 5e-3, True, "the rows are the cause, not the training"), (1e-5, 1e-8, False, ""),
    (5.0, 5.0, True, "the atoms leave as much")])
def test_rows_that_leave_what_atoms_could_remove_are_the_cause(
    inside: float, outside: float, noted: bool, cause: str
) -> None:
    """Not where the error is small; where the atoms leave as much, they are a cause, too."""
    state, _, force = beside(inside, outside)
    notes = checked(state, orthogonal_atoms(), 8)
    assert bool(notes) == noted
    for note in notes:
        assert note.kind == "sampled_rows" and note.level is Level.WARNING
        assert f"the 8 sampled rows of {NAME}" in note.text and cause in note.text
        assert f"an error of {error_of(force, state):.2g} of" in note.text


def error_of(force: FloatArray, state: State) -> float:
    """Temperature that the force causes over the run, relative to the largest change."""
    model = full().model
    data = model.block_data(NAME)
    S = (data.stiffness + data.mass / state.t).toarray()
    change = np.linalg.norm(state.x[model.layout[NAME]] - model.x0[model.layout[NAME]])
    return float(np.linalg.norm(np.linalg.solve(S, force)) / change)


@pytest.mark.parametrize(("inside", "level"), [(5.0, Level.WARNING), (1e-5, Level.INFORMATION)])
def test_numbers_are_those_of_the_residual(inside: float, level: Level) -> None:
    """Right values by construction: the residual is D times a known displacement of the state."""
    state, ratio, force = beside(inside, 1e-3 * inside)
    (note,) = checked(state, orthogonal_atoms())
    error = error_of(force, state)
    assert note.kind == "selected_atoms" and note.level is level
    assert f"3 of 4 atoms selected in {NAME}" in note.text
    assert f"{ratio:.2g} times" in note.text and f"an error of {error:.2g} of" in note.text


def test_no_note_where_all_atoms_leave_as_much() -> None:
    state, ratio, _ = beside(1.0, 1.0)
    assert ratio < RATIO and not checked(state, orthogonal_atoms())


@pytest.mark.full
@pytest.mark.parametrize("g", [0.0, -9.81])
def test_atoms_that_no_step_uses_are_said(g: float) -> None:
    """A bar without loads, trained under gravity."""
    run = simulate(tiny().using({
        "time.end": 0.005, "training.end": 0.005, "bodies.bar.fields": ["elastic"],
        "loads": {"gravity": {"use": "gravity", "g": [0.0, g]}},
        "training.overrides": {"loads.gravity.g": [0.0, -9.81]},
        "reducer": {"use": "sparse", "solver": "omp", "basis": {"use": "pod", "count": 4},
                    "budgets": {"*.elastic": {"atoms": 2}}}}))
    assert ("none of the 4 atoms of bar.elastic was active in any step: it kept its initial values"
            in run.summary["information"]) == (g == 0.0)


@pytest.mark.full
def test_selection_that_fails_says_so() -> None:
    """Orthogonal matching pursuit on plain rows, 8 of 16 elastic atoms: wrong and noted (0.016); on
    rows of D^-1 r it is near the best 8 (1e-7) and casts no doubt."""
    scene = coarse_pendulum().using({
        "bodies.link1.capacity": "consistent", "bodies.link2.capacity": "consistent",
        "time.end": 0.3, "training.end": 0.3})
    reference = simulate(scene.using({"reducer": "full"}))
    for residual, wrong in (("plain", True), ("auto", False)):
        run = simulate(scene.using({"reducer": {
            "use": "sparse", "residual": residual, "solver": "omp", "every": 10,
            "basis": {"use": "pod", "count": 16}, "budgets": {"*.elastic": {"atoms": 8}}}}))
        error = compare(reference, x=run).errors["x"]["elastic"]
        assert error > 1e-2 if wrong else error < 1e-5, (residual, error)
        assert ("selected_atoms" in run.summary["note_kinds"]) == wrong, run.summary["notes"]


@pytest.mark.full
def test_plain_rows_that_a_new_load_makes_wrong_are_noted_as_the_cause() -> None:
    """Plain rows of a bar whose modulus falls with temperature. With another load than in training
    they are 20 times and more worse than all rows; the note knows their error within a third."""
    curve = {"temperatures": [293.15, 313.15, 493.15], "values": [7e10, 6e10, 4e10]}
    scene = scene_of({
        "bodies": {"b": {
            "use": "flexible", "thickness": 0.02, "fields": ["elastic", "thermal"],
            "frame": "fixed", "reference": {"clamp": "left"}, "initial_temperature": 293.15,
            "mesh": {"use": "rectangle", "size": [1.0, 0.1], "divisions": [16, 3]},
            "sets": {"below": {"box": [[0.4, 0.8], [-0.01, 0.01]]},
                     "above": {"box": [[0.2, 0.5], [0.09, 0.11]]}},
            "material": {"E": curve, "nu": 0.3, "rho": 2700.0, "alpha": 2.3e-5, "k": 150.0,
                         "c": 900.0}}},
        "loads": {
            "heat": {"use": "heat_flux", "on": ["b:above"], "flux": 2e5},
            "pull": {"use": "traction", "on": ["b:below"], "traction": [1e7, 5e6],
                     "factor": {"use": "ramp", "end": 10.0, "final": 1.0}}},
        "time": {"end": 20.0, "step": 0.5}, "integrator": "bdf2",
        "training": {"end": 20.0, "overrides": {
            "loads.pull.factor": {"use": "constant", "level": 0.3},
            "loads.heat.flux": {"use": "pulse", "start": 2.0, "duration": 8.0, "level": 1e5}}}})
    whole = simulate(scene.using({"reducer": "full"}))
    best, run = (simulate(scene.using({"reducer": use})) for use in (
        "galerkin", {"use": "sparse", "residual": "plain", "sampler": "deim"}))
    least, error = (compare(whole, x=r).errors["x"]["elastic"] for r in (best, run))
    assert error > max(0.01, 5.0 * least), (error, least)
    notes = [n for n in run.summary["notes"] if "the rows are the cause" in n]
    assert len(notes) == 1 and "b.elastic" in notes[0], run.summary["notes"]
    said = float(notes[0].split("an error of ")[1].split()[0])
    assert said == pytest.approx(error, rel=0.33)
    assert not [n for n in run.summary["notes"] if "left the range" in n and "b.elastic" in n]
    assert not [n for n in best.summary["notes"] if "rows" in n]


# ------------------------------------------------------------------- few rows, dependent atoms

PLATE = {
    "use": "flexible", "thickness": 0.01, "fields": ["thermal"], "frame": "fixed",
    "mesh": {"use": "rectangle", "size": [0.1, 0.02], "divisions": [8, 2]},
    "reference_temperature": 300.0, "initial_temperature": 1200.0}
FEW = {"use": "sparse", "budgets": {"*.thermal": {"rows": 3, "atoms": 3}}}


@pytest.mark.full
@pytest.mark.parametrize(("k", "load"), [
    (50.0, {"use": "radiation", "emissivity": 0.9, "surroundings": 300.0}),
    (50.0, {"use": "convection", "film": {"temperatures": [300.0, 1300.0], "values": [10.0, 200.0]},
            "temperature": 300.0}),
    ({"temperatures": [300.0, 1300.0], "values": [50.0, 30.0]},
     {"use": "heat_flux", "flux": -5.0e4}),
], ids=["radiation", "film", "conductivity"])
@pytest.mark.parametrize("every", [1, 4])
def test_fewer_rows_than_atoms_with_a_pointwise_law(k: Any, load: Any, every: int) -> None:
    """A first selection without previous atoms, and without rows for all of them, starts from no
    atoms at all; the temperatures are then near those of full order, or a warning says more."""
    scene = scene_of({
        "bodies": {"p": {**PLATE, "material": {"rho": 7850.0, "k": k, "c": 470.0}}},
        "loads": {"edge": {**load, "on": ["p:right"]}}, "time": {"end": 10.0, "step": 1.0},
        "training": {"end": 10.0}, "reducer": {**FEW, "every": every}})
    run = simulate(scene)
    errors = compare(simulate(scene.using({"reducer": "full"})), x=run).errors["x"]
    assert errors["combined"] < 0.02
    assert errors["thermal"] < 0.05 or "sampled_rows" in run.summary["note_kinds"], errors
    assert run.summary["rows"] == {"p.thermal": 6}


@pytest.mark.full
def test_dependent_atoms_are_made_independent_where_all_are_used() -> None:
    """POD, modes and static responses side by side: their span, as with galerkin; where atoms are
    selected the dictionary stays as it is."""
    whole = {"use": "sparse", "basis": "dictionary"}
    run = prepared(tiny().using({"reducer": whole}))
    twin = prepared(tiny().using({"reducer": {**whole, "use": "galerkin"}}))
    name = "bar.elastic"
    atoms, span = (s.dictionaries[name].atoms for s in (run, twin))
    assert atoms.shape == span.shape
    np.testing.assert_allclose(atoms.T @ atoms, np.eye(atoms.shape[1]), atol=1e-12)
    Q = np.linalg.qr(span)[0]
    np.testing.assert_allclose(Q @ (Q.T @ atoms), atoms, atol=1e-6)
    assert "span" in [n.kind for n in run.notes]
    chosen = prepared(tiny().using({"reducer": {
        **whole, "budgets": {"*.elastic": {"rows": 20, "atoms": 4}}}}))
    assert chosen.dictionaries[name].atoms.shape[1] > atoms.shape[1]
