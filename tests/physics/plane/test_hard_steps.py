"""Steps on which a constant factor misleads: soft bodies spinning fast, radiation in long steps."""

import numpy as np
import pytest

from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import start_notes
from sparsemor.core.notes import Note
from sparsemor.core.scene.scene import load
from sparsemor.core.testing.in_memory_run import march, scene_of

RUBBER = {
    "use": "flexible", "thickness": 0.02, "fields": ["elastic"],
    "material": {"E": 5e6, "nu": 0.3, "rho": 1100},
    "mesh": {"use": "rectangle", "lower": [-0.1, -0.05], "size": [0.5, 0.1], "divisions": [10, 2]},
    "reference": {"chord": ["bottom_left", "bottom_right"]},
}
GLOWING = {
    "use": "flexible", "thickness": 0.02, "fields": ["thermal"], "frame": "fixed",
    "material": {"rho": 2000, "k": 30, "c": 500}, "initial_temperature": 1500,
    "mesh": {"use": "rectangle", "size": [0.1, 0.05], "divisions": [6, 3]},
}


@pytest.mark.full
@pytest.mark.parametrize("spin", [8.0, 30.0, 100.0])
def test_a_soft_body_that_spins_fast(spin: float) -> None:
    """Coriolis and centrifugal terms are not in the constant block; the step converges to the
    exact Newton's solution all the same."""
    runs = [march(scene_of({
        "bodies": {"plate": {**RUBBER, "pose": {"spin": spin}}},
        "time": {"end": 0.02, "step": 1e-3},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0},
        "reducer": {"use": "full", "method": method}})) for method in ("bordered", "newton")]
    fast, plain = runs
    for name in ("plate.rigid", "plate.elastic"):
        size = np.abs(plain.block(name)).max()
        assert np.abs(fast.block(name) - plain.block(name)).max() < 1e-9 * size
    assert max(fast.iterations) < 25


@pytest.mark.full
def test_radiation_in_long_steps() -> None:
    """4 eps sigma T^3 outweighs capacity and conduction here, so the fixed factor diverges."""
    scene = {
        "bodies": {"plate": GLOWING}, "time": {"end": 1e6, "step": 1e5}, "integrator": "bdf1",
        "loads": {"glow": {"use": "radiation", "on": ["plate:left", "plate:top"],
                           "emissivity": 0.9, "surroundings": 400},
                  "lamp": {"use": "heat_flux", "on": ["plate:right"], "flux": 2e4}}}
    fast, plain = (march(scene_of({**scene, "reducer": {"use": "full", "method": m}}))
                   for m in ("bordered", "newton"))
    assert np.abs(fast.x - plain.x).max() < 1e-9 * np.abs(plain.x).max()
    # an extrapolation below 0 K must not lead to the second solution that radiation has there
    assert fast.x.min() > 400.0
    assert max(fast.iterations) <= 25


@pytest.mark.full
def test_velocities_that_break_a_joint_are_noted() -> None:
    body = {"use": "rigid", "mass": 1.0, "inertia": 0.1, "points": {"pin": [0.0, 0.0]}}
    joint = {"pin": {"use": "revolute", "between": ["ground", "bar:pin"]}}
    shake = {"pin": {"use": "prescribed_motion", "of": "bar:pin",
                     "x": {"use": "sine", "amplitude": 0.1, "frequency": 1.0}}}
    time = {"time": {"end": 0.01, "step": 1e-3}}

    def notes(joints: object, velocity: list[float]) -> tuple[Note, ...]:
        pose = {"pose": {"velocity": velocity}}
        return start_notes(assemble(scene_of(
            {"bodies": {"bar": {**body, **pose}}, "joints": joints, **time})))

    assert notes(joint, [0.0, 0.0]) == ()
    assert "break joint pin by 2 m/s" in notes(joint, [2.0, 0.0])[0].text
    assert "break joint pin by 0.628 m/s" in notes(shake, [0.0, 0.0])[0].text
    assert notes(shake, [2 * np.pi * 0.1, 0.0]) == ()
    assert start_notes(assemble(load("double_pendulum"))) == ()
