"""Inputs that are almost surely mistakes: each is a warning with the number that shows it."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.core.notes import Level
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.checks import Checks
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.validation import checked_model
from tiers import quick

SCENES = Path(__file__).parents[2] / "scenes"
TINY = SCENES / "tiny.yaml"
RADIATION = {"use": "radiation", "on": ["bar:top"], "emissivity": 0.8}
HEAT = {"use": "heat_flux", "on": ["bar:right"]}
GALERKIN = {"use": "galerkin"}
BEFORE: dict[str, tuple[dict[str, Any], str, str]] = {
    "a probe 1 km off": (
        {"probes": {"tip": {"body": "bar", "at": [1000.0, 0.0]}}}, "distant_point",
        "probes.tip at (1000, 0) is 1e+03 m outside its body, whose diagonal is 0.51 m"),
    "a set 500 m off": (
        {"bodies.bar.sets.far": {"nearest": [0.0, -500.0]}}, "distant_point",
        "bodies.bar.sets.far at (0, -500) is 500 m outside its body"),
    "surroundings in Celsius": (
        {"loads.glow": {**RADIATION, "surroundings": 20.0}}, "celsius",
        "the surroundings is 20 K, which is -253.1 degrees Celsius"),
    "a body in Celsius": (
        {"loads.glow": {**RADIATION, "surroundings": 293.15},
         "bodies.bar.initial_temperature": 20.0}, "celsius",
        "the initial temperature of bar is 20 K, which is -253.1 degrees Celsius"),
    "a fluid in Celsius": (
        {"loads.air": {"use": "convection", "on": ["bar:top"], "film": 10.0, "temperature": 60.0}},
        "celsius", "the temperature of air is 60 K, which is -213.1 degrees Celsius, and the "
        "initial temperature of bar is"),
    "a prescribed temperature in Celsius": (
        {"joints.hot": {"use": "prescribed_temperature", "on": ["bar:left"], "temperature": 80.0}},
        "celsius", "the temperature of hot is 80 K"),
    "a stress-free temperature in Celsius": (
        {"bodies.bar.reference_temperature": 20.0, "bodies.bar.initial_temperature": 300.0},
        "celsius", "the reference temperature of bar is 20 K"),
    "a bar in millimetres": (
        {"bodies.bar.mesh.size": [500.0, 100.0], "bodies.bar.mesh.lower": [0.0, -50.0],
         "bodies.bar.sets.end_b.nearest": [500.0, 0.0]},
        "unlikely_size", "bar is 500 m long at a density of"),
    "a bar of a twentieth of a millimetre": (
        {"bodies.bar.mesh.size": [5e-5, 1e-5], "bodies.bar.mesh.lower": [0.0, -5e-6],
         "bodies.bar.sets.end_b.nearest": [5e-5, 0.0]},
        "unlikely_size", "bar is 5e-05 m long"),
    "a body without the joint that holds it": (
        {"bodies.free": {"use": "rigid", "mass": 1.0, "inertia": 0.1, "points": {"p": [0, 0]}}},
        "unheld_body", "free hangs on nothing"),
    "a start below absolute zero": (
        {"bodies.bar.initial_temperature": -20.0}, "impossible_temperature",
        "initial temperatures of bar are in K and fall to -20 K, below absolute zero"),
    "a prescribed temperature of 1e9 K": (
        {"joints.hot": {"use": "prescribed_temperature", "on": ["bar:left"],
                        "temperature": {"use": "ramp", "end": 0.01, "initial": 293.15,
                                        "final": 1e9}}}, "impossible_temperature",
        "prescribed temperatures of bar reach 1e+09 K"),
    "a pulse between two steps": (
        {"loads.heating": {**HEAT, "flux": {
            "use": "pulse", "start": 0.0052, "duration": 1e-6, "level": 3e6}}}, "never_acts",
        "loads.heating.flux is 0 at all 40 steps and never acts; it reaches 3e+06 at 0.0052 s, "
        "between two steps"),
    "a load that begins after the end": (
        {"loads.heating": {**HEAT, "flux": {
            "use": "ramp", "start": 1.0, "end": 2.0, "final": 3e6}}}, "never_acts",
        "which is after time.end = 0.04 s"),
    "one step per period": (
        {"loads.heating": {**HEAT, "flux": {
            "use": "sine", "frequency": 1000.0, "amplitude": 1e6}}}, "never_acts",
        "loads.heating.flux is 0 at all 40 steps"),
    "one step per period about a mean": (
        {"loads.heating": {**HEAT, "flux": {
            "use": "sine", "frequency": 1000.0, "amplitude": 1e6, "offset": 1e6}}}, "too_fast",
        "1 steps per period"),
    "three steps per period": (
        {"loads.heating": {**HEAT, "flux": {
            "use": "sine", "frequency": 333.0, "amplitude": 1e6}}}, "too_fast",
        "steps per period: take time.step of at most 0.000"),
    "a tenth of the run": (
        {"reducer": GALERKIN, "training.end": 0.004}, "short_training",
        "the training run ends at 0.004 s, 10 % of time.end = 0.04 s"),
}


@pytest.mark.parametrize("changes, kind, message", BEFORE.values(), ids=list(BEFORE))
def test_a_mistake_is_told_before_the_run(changes, kind, message):
    scene = load(TINY, changes)
    (note,) = [n for n in Checks.for_scene(
        scene).of_model(scene, checked_model(scene)) if n.kind == kind]
    assert message in note.text


FINE: dict[str, dict[str, Any]] = {
    "as it is": {},
    "a probe inside": {"probes": {"mid": {"body": "bar", "at": [0.21, 0.013]}}},
    "surroundings of space": {"loads.glow": {**RADIATION, "surroundings": 3.0}},
    "no heat at all": {"loads.heating.flux": 0.0},
    "eight steps per period": {"loads.heating": {**HEAT, "flux": {
        "use": "sine", "frequency": 125.0, "amplitude": 1e6}}},
    "a pulse of the last steps": {"loads.heating": {**HEAT, "flux": {
        "use": "pulse", "start": 0.03, "duration": 1.0, "level": 1e6}}},
    "a pulse of one step and a half": {"loads.heating": {**HEAT, "flux": {
        "use": "pulse", "start": 0.0103, "duration": 1.5e-3, "level": 1e6}}},
    "liquid nitrogen": {"loads.air": {"use": "convection", "on": ["bar:top"], "film": 10.0,
                                      "temperature": 77.36}},
    "temperatures relative to a start": {
        "bodies.bar.initial_temperature": 0.0, "bodies.bar.reference_temperature": 0.0,
        "loads.air": {"use": "convection", "on": ["bar:top"], "film": 10.0, "temperature": 20.0}},
    "a free body that flies": {"joints": {}, "bodies.bar.pose": {"velocity": [1.0, 0.0]}},
    "two bodies on one pin": {
        "bodies.free": {"use": "rigid", "mass": 1.0, "inertia": 0.1, "points": {"p": [0.5, 0]}},
        "joints.hold": {"use": "revolute", "between": ["bar:right", "free:p"]}},
    "a body on a spring": {
        "bodies.free": {"use": "rigid", "mass": 1.0, "inertia": 0.1, "points": {"p": [0.7, 0]}},
        "joints.hold": {"use": "spring_damper", "between": ["bar:right", "free:p"],
                        "stiffness": 1.0}},
    "half of the run": {"reducer": GALERKIN, "training.end": 0.02},
    "full order needs no training": {"training.end": 0.004},
}


@pytest.mark.parametrize("changes", FINE.values(), ids=list(FINE))
def test_what_is_no_mistake_is_not_told(changes):
    scene = load(TINY, {"bodies.bar.order": 2, **changes})
    assert Checks.for_scene(scene).of_model(scene, checked_model(scene)) == ()


@pytest.mark.full
@pytest.mark.parametrize("name", [
    "double_pendulum", "slider_plate", *sorted(str(p) for p in SCENES.glob("*.yaml"))])
def test_our_own_scenes_are_plausible(name):
    """But for what is said of the elements of coarse meshes."""
    scene = load(name)
    found = Checks.for_scene(scene).of_model(scene, checked_model(scene))
    assert [n for n in found if n.kind != "stiff_in_bending"] == []


def test_a_scene_in_celsius_that_radiates_is_told_of_its_cold_temperatures():
    """The stress-free temperature of 20 shows it; surroundings of 200 alone might be kelvin, and a
    start of 800 may be."""
    scene = load(TINY, {"loads.glow": {**RADIATION, "surroundings": 200.0},
                        "bodies.bar.reference_temperature": 20.0, "bodies.bar.order": 2,
                        "bodies.bar.initial_temperature": 800.0})
    found = Checks.for_scene(scene).of_model(scene, checked_model(scene))
    assert [n.kind for n in found] == ["celsius"] * 2
    for what in ("reference temperature of bar is 20 K", "surroundings is 200 K"):
        assert any(what in n.text for n in found)


def test_a_free_body_at_rest_under_loads_is_no_warning():
    scene = load(TINY, {"joints": {}, "bodies.bar.order": 2})
    (note,) = Checks.for_scene(scene).of_model(scene, checked_model(scene))
    assert (note.kind, note.level) == ("unheld_body", Level.INFORMATION)


@pytest.mark.full
@pytest.mark.parametrize(("reducer", "what"), [
    ({"use": "galerkin", "basis": {"use": "pod", "count": 500}}, "bar.elastic: 500 atoms"),
    ({"use": "sparse", "basis": {"use": "pod", "count": 3},
      "budgets": {"bar.elastic": {"atoms": 7}}},
     "bar.elastic: 7 atoms are asked for, and 3 exist")])
def test_more_atoms_than_exist_are_said(here, reducer, what):
    summary = simulate(load(TINY, {"reducer": reducer, "time.end": 0.01})).summary
    assert any(text.startswith(what) for text in summary["information"]), summary["information"]


@pytest.mark.full
def test_a_run_that_ends_beyond_linear_elasticity_is_noted(here):
    # a bar of 0.5 m at 293 K above the temperature without stress grows by 0.15 m
    scene = load(TINY, {"bodies.bar.material.alpha": 1e-3, "bodies.bar.reference_temperature": 0.0,
                        "bodies.bar.initial_temperature": 293.0, "time.end": 0.005,
                        "time.step": 5e-3})
    summary = simulate(scene).summary
    (note,) = [n for n in summary["notes"] if "displacements of bar reach" in n]
    assert "times its smallest extent of 0.1 m" in note
    assert "large_displacement" in summary["note_kinds"]


@pytest.mark.full
@pytest.mark.parametrize("reducer", quick(["full", "galerkin"], "full"))
def test_a_run_that_melts_is_noted(here, reducer):
    scene = load(TINY, {"loads.heating.flux": 1e11, "time.end": 0.01, "reducer": reducer,
                        "bodies.bar.material.alpha": 0.0})
    summary = simulate(scene).summary
    (note,) = [n for n in summary["notes"] if "temperatures of bar reach" in n]
    assert "no solid is that hot" in note


@pytest.mark.full
def test_a_run_that_falls_below_absolute_zero_is_noted(here):
    scene = load(TINY, {"loads.heating.flux": -1e10, "time.end": 0.01,
                        "bodies.bar.initial_temperature": 293.15,
                        "bodies.bar.material.alpha": 0.0})
    (note,) = [n for n in simulate(scene).summary["notes"] if "below absolute zero" in n]
    assert note.startswith("temperatures of bar are in K and fall to -")


@pytest.mark.full
@pytest.mark.parametrize("reducer", [
    {"use": "galerkin", "basis": {"use": "pod", "count": 1}},
    {"use": "galerkin", "bases": {"*.elastic": {"use": "modal", "count": 1, "start": False}}},
])
def test_one_atom_is_noted(here, reducer):
    scene = load(TINY, {"reducer": reducer, "time.end": 0.01})
    (note,) = [n for n in simulate(scene).summary["notes"] if n.startswith("bar.elastic is redu")]
    assert "1 atom for 51 unknowns" in note


def test_a_crack_in_a_mesh_file_is_counted(tmp_path):
    whole = Rectangle(lower=(0.0, -0.05), size=(0.5, 0.1), divisions=(8, 2)).build(tmp_path)
    x, y = whole.points.T
    cut = np.flatnonzero((np.abs(x - 0.25) < 1e-9) & (y < -1e-9))  # a notch from below
    doubled = np.arange(len(cut)) + len(x)
    cells = whole.cells.copy()
    right = x[cells].mean(axis=1) > 0.25
    for old, new in zip(cut, doubled, strict=True):
        cells[right] = np.where(cells[right] == old, new, cells[right])
    meshio.Mesh(np.concatenate([whole.points, whole.points[cut]]), [("triangle", cells)]).write(
        tmp_path / "cracked.vtk")
    scene = load(TINY, {"bodies.bar.order": 2,
                        "bodies.bar.mesh": {"use": "file", "path": str(tmp_path / "cracked.vtk")},
                        "bodies.bar.sets": {"end_a": {"nearest": [0.0, 0.0]},
                                            "end_b": {"nearest": [0.5, 0.0]},
                                            "left": {"where": "x < 1e-9"},
                                            "right": {"where": "x > 0.4999"}}})
    (note,) = Checks.for_scene(scene).of_model(scene, checked_model(scene))
    assert note.kind == "coincident_nodes" and note.text.startswith(f"{len(cut)} nodes of bar")
