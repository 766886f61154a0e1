"""Bodies that are hot at the start, at steps much longer than their vibrations."""

from typing import Any

import numpy as np
import pytest

from sparsemor import simulate
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state, euler_state, resolved_start
from sparsemor.core.testing.in_memory_run import scene_of

HALF: dict[str, Any] = {"use": "generalized_alpha", "rho_inf": 0.5}


def bar(at: float, start: float) -> dict[str, Any]:
    return {"use": "flexible", "thickness": 0.01, "fields": ["elastic", "thermal"],
            "mesh": {"use": "rectangle", "lower": [0.0, -0.01], "size": [0.1, 0.02],
                     "divisions": [10, 2]},
            "material": {"E": 7e10, "nu": 0.3, "rho": 2700.0, "alpha": 2e-5, "k": 200.0,
                         "c": 900.0},
            "reference": {"clamp": "left"}, "initial_temperature": start,
            "pose": {"position": [at, 0.0]}}


def welded(integrator: Any, h: float, steps: int, **more: Any) -> Any:
    """Two bars at 393.15 and 293.15 K, welded to each other and to the ground."""
    return scene_of({
        "bodies": {"a": bar(0.0, 393.15), "b": bar(0.1, 293.15)},
        "joints": {"g": {"use": "fixed", "between": ["ground", "a:left"]},
                   "w": {"use": "fixed", "between": ["a:right", "b:left"], "conductance": 5.0}},
        "time": {"end": h * steps, "step": h}, "integrator": integrator, **more})


@pytest.mark.full
@pytest.mark.parametrize("integrator, reducer", [
    ("bdf2", "full"), ("generalized_alpha", "galerkin"), (HALF, "full")])
def test_steps_of_ten_seconds_end_at_the_mean_temperature(integrator: Any, reducer: str) -> None:
    """Two equal bars without losses: (393.15 + 293.15)/2 K; each is then longer by alpha dT L with
    dT = 50 K, 1e-4 m. The start has 4e7 m/s2, 2e9 m in one step: it turned frames by 1e19 rad."""
    run = simulate(welded(integrator, 10.0, 100, reducer=reducer))
    for body in "ab":
        assert run.block(f"{body}.thermal")[-1] == pytest.approx(343.15, abs=1e-5)
        assert np.abs(run.block(f"{body}.elastic")[-1]).max() == pytest.approx(1e-4, rel=0.1)
    assert any("the vibrations of a at the start" in n for n in run.summary["information"])
    assert "alternating_forces" not in run.summary["note_kinds"]  # they have died out


@pytest.mark.full
@pytest.mark.parametrize("h", [1e-2, 1e-4])
def test_shorter_steps_stay_near_the_thermal_strain(h: float) -> None:
    """A suddenly loaded undamped bar goes at most to twice its static elongation of 2e-4 m."""
    run = simulate(welded("generalized_alpha", h, 20))
    assert np.abs(run.block("a.elastic")).max() < 4.2e-4


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["bdf2", "generalized_alpha"])
def test_the_fall_of_a_hot_bar_keeps_its_acceleration(integrator: str) -> None:
    """-g t^2/2 for its frame, but for the motion of the clamp against the centre, below 0.1 mm per
    vibration; without accelerations at the start generalized_alpha is 4 mm off."""
    scene = scene_of({
        "bodies": {"a": bar(0.0, 393.15)}, "loads": {"g": {"use": "gravity"}},
        "time": {"end": 0.1, "step": 0.01}, "integrator": integrator})
    run = simulate(scene)
    assert run.block("a.rigid")[-1, 1] == pytest.approx(-0.5 * 9.81 * 0.01, abs=1e-4)


@pytest.mark.full
def test_accelerations_of_a_step_tend_to_those_at_the_start() -> None:
    model = assemble(welded("bdf2", 1e-3, 1))
    at = model.layout.second
    want = consistent_state(model).a[at]
    off = [np.abs(euler_state(model, h).a[at] - want).max() / np.abs(want).max()
           for h in (1e-9, 1e-10)]
    assert off[1] < 1e-3 and off[1] < 0.2 * off[0]
    assert np.abs(euler_state(model, 10.0).a).max() < 1e-3
    integrator = scene_of({"time": {"end": 1.0, "step": 0.1}, "integrator": "bdf2",
                           "bodies": {"a": bar(0.0, 300.0)}}).integrator
    assert resolved_start(model, integrator, 1e-6).shaken == ""
    assert resolved_start(model, integrator, 1e-3).shaken == "a"
