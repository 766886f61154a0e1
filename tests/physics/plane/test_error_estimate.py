"""Estimated errors of reduced runs against errors measured with the full-order run."""

from typing import Any

import numpy as np
import pytest

from reduced_runs import errors, estimates, learnt
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.testing.in_memory_run import march, scene_of

INTEGRATORS = ["bdf1", "bdf2", {"use": "generalized_alpha", "rho_inf": 0.8}]
NAMES = ["bdf1", "bdf2", "generalized_alpha"]


def bar(fields: list[str], loads: dict[str, Any], integrator: Any, end: float) -> Scene:
    """A clamped strip at rest of 33 nodes."""
    return scene_of({
        "bodies": {"bar": {
            "use": "flexible", "frame": "fixed", "fields": fields, "thickness": 0.02,
            "mesh": {"use": "rectangle", "size": [0.1, 0.01], "divisions": [10, 2]},
            "reference": {"clamp": "left"},
            "material": {"E": 7e10, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 150, "c": 900},
            "damping": {"stiffness": 1e-6, "mass": 0.1} if "elastic" in fields else {}}},
        "joints": {}, "loads": loads, "time": {"end": end, "step": end / 20},
        "integrator": integrator})


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=NAMES)
def test_heat_of_a_strip_is_estimated_to_a_ten_thousandth(integrator: Any) -> None:
    """By fewer vectors than the strip has unknowns."""
    scene = bar(["thermal"], {"flux": {"use": "heat_flux", "on": ["bar:right"], "flux": 1e6}},
                integrator, 0.5)
    full = march(scene)
    reduced = scene.using({"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 2}}})
    run = march(reduced, model=full.model, snapshots=learnt(full))
    true = errors(full, run, "bar.thermal")
    assert true.max() > 1e-3
    assert estimates(reduced, run)["bar.thermal"] == pytest.approx(true, rel=1e-4, abs=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("integrator", INTEGRATORS, ids=NAMES)
def test_vibration_and_thermal_bending_are_estimated_to_a_thousandth(integrator: Any) -> None:
    """Errors of temperatures act on displacements as thermal loads. What is left is the error of
    the initial accelerations outside the space, which generalized_alpha damps the least."""
    loads = {"flux": {"use": "heat_flux", "on": ["bar:top"], "flux": 1e6},
             "pull": {"use": "traction", "on": ["bar:right"], "traction": [1e5, 1e5]}}
    scene = bar(["elastic", "thermal"], loads, integrator, 1e-3)
    full = march(scene)
    reduced = scene.using({"reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 2}}})
    run = march(reduced, model=full.model, snapshots=learnt(full))
    found = estimates(reduced, run)
    for name in ("bar.elastic", "bar.thermal"):
        true = errors(full, run, name)
        assert true.max() > 0.0
        close = 1e-3 if isinstance(integrator, str) else 3e-3
        assert found[name] == pytest.approx(true, rel=close, abs=1e-6 * true.max()), name


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["galerkin", "deim"])
def test_a_pendulum_outside_its_training_is_estimated(reducer: str) -> None:
    """Trained on the first third of the run: the estimate follows the error of each link."""
    scene = load("double_pendulum", {
        "bodies.link1.capacity": "consistent", "bodies.link2.capacity": "consistent",
        "bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320, "time.end": 0.12})
    full = march(scene.using({"reducer": "full"}))
    part = {n: s[:, :41] for n, s in learnt(full).items()}
    reduced = scene.using({"reducer": {"use": reducer, "basis": {"use": "pod", "count": 6}}})
    run = march(reduced, model=full.model, snapshots=part)
    found = estimates(reduced, run)
    for name in full.model.reducible():
        true, late = errors(full, run, name), slice(60, None)
        change = np.linalg.norm(full.block(name) - full.block(name)[0], axis=1).max()
        assert true[late].max() > 1e-8 * change, name
        ratio = found[name][late].max() / true[late].max()
        assert 0.7 < ratio < 1.4, (name, ratio)


@pytest.mark.full
@pytest.mark.parametrize("trained", [6e5, 1.5e5])
def test_steel_whose_properties_depend_on_temperature_is_estimated(trained: float) -> None:
    """k(T), c(T), E(T) and alpha(T) with radiation, trained on the flux of the run or a quarter."""
    def strip(flux: float) -> Scene:
        scene = bar(["elastic", "thermal"], {
            "flux": {"use": "heat_flux", "on": ["bar:top"], "flux": flux},
            "glow": {"use": "radiation", "on": ["bar:right"], "emissivity": 0.7,
                     "surroundings": 293.15}}, "bdf1", 20.0)
        return scene.using({"bodies.bar.material": "carbon_steel"})

    full = march(strip(6e5))
    assert full.block("bar.thermal").max() > 450.0
    reduced = strip(6e5).using({"reducer": {
        "use": "galerkin", "basis": {"use": "pod", "count": 3}}})
    learning = full if trained == 6e5 else march(strip(trained))
    run = march(reduced, model=full.model, snapshots=learnt(learning))
    found = estimates(reduced, run)
    for name in ("bar.elastic", "bar.thermal"):
        true = errors(full, run, name)
        assert 0.8 < found[name].max() / true.max() < 1.25, name
