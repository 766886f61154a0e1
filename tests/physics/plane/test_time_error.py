"""Steps that are too long, and energy that an integrator takes, are estimated and noted with about
the right number; resolved runs have no note."""

from typing import Any

import numpy as np
import pytest

from sparsemor.core.notes import Note
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.simulate import simulate
from sparsemor.plugins.checks.energy_lost import energy_notes
from sparsemor.plugins.checks.time_error import time_error_notes

PENDULUM: dict[str, Any] = {
    "bodies": {"b": {"use": "rigid", "mass": 1.0, "inertia": 1.0 / 12.0, "center": [0.5, 0.0],
                     "points": {"a": [0.0, 0.0]}}},
    "joints": {"j": {"use": "revolute", "between": ["ground", "b:a"]}},
    "loads": {"g": {"use": "gravity"}}}
"""Uniform rod of 1 m that is released from horizontal: w^2/6 + 9.81/2 sin(angle) is constant."""


def swing(integrator: str, h: float, end: float) -> RunResult:
    return simulate(load(
        {**PENDULUM, "integrator": integrator, "time": {"end": end, "step": h}}))


def angle(run: RunResult) -> Any:
    return run.block("b.rigid")[:, 2]


@pytest.mark.full
@pytest.mark.parametrize("integrator, h", [("bdf1", 0.02), ("generalized_alpha", 0.1)])
def test_a_step_too_long_is_noted_with_its_error(integrator: str, h: float) -> None:
    """The error against a step of a tenth, relative to the largest change."""
    run, exact = swing(integrator, h, 2.0), swing(integrator, 0.1 * h, 2.0)
    change = np.abs(angle(exact)).max()
    error = np.abs(angle(run) - angle(exact)[::10]).max() / change
    estimate = run.summary["time_error"]["b.rigid"]
    assert error > 0.01
    assert 0.2 * error < estimate < 5.0 * error
    assert "time_error" in [*run.summary["note_kinds"]] or any(
        "time error" in n for n in run.summary["information"])


@pytest.mark.full
def test_a_resolved_run_has_a_small_estimate_and_no_note() -> None:
    run = swing("generalized_alpha", 0.005, 0.25)
    assert 0.0 < run.summary["time_error"]["b.rigid"] < 0.003
    assert run.summary["energy_lost"] is None
    assert not [n for n in (*run.summary["notes"], *run.summary["information"])
                if "time error" in n or "takes energy" in n]


@pytest.mark.full
def test_energy_that_implicit_euler_takes_is_noted_within_a_third() -> None:
    """Loss from the first to the last steps, w from differences of the angle."""
    run = swing("bdf1", 0.02, 3.0)
    turned = angle(run)
    w = np.gradient(turned, run.times)
    energy = w**2 / 6.0 + 0.5 * 9.81 * np.sin(turned)
    lost = (energy[1] - energy[-2]) / (w**2 / 6.0).max()
    assert lost > 0.1
    assert run.summary["energy_lost"] == pytest.approx(lost, rel=0.35)
    assert "energy_lost" in run.summary["note_kinds"]


@pytest.mark.full
def test_a_fall_loses_the_energy_of_one_step_in_as_many() -> None:
    """Implicit Euler falls with the exact speed, n h g, and h/2 of it too far at each step: 1/n of
    the kinetic energy, half of what the same accelerations cost a vibration."""
    time = {"end": 1.0, "step": 0.02}
    fall = load({**PENDULUM, "joints": {}, "integrator": "bdf1", "time": time})
    assert simulate(fall).summary["energy_lost"] == pytest.approx(1.0 / 50.0, rel=0.05)


def rod(length: float, a: Any, b: Any) -> dict[str, Any]:
    return {"use": "rigid", "mass": length, "inertia": length**3 / 12, "center": [length / 2, 0.0],
            "points": {"a": [0.0, 0.0], "b": [length, 0.0]},
            "pose": {"position": a.tolist(), "angle": float(np.arctan2(*(b - a)[::-1]))}}


@pytest.mark.full
def test_all_blocks_of_a_closed_loop_are_told_of_their_delay() -> None:
    """A four-bar of rods that falls through its lowest position: errors of 7 to 23 % against a
    tenth of the step."""
    a, d, b = 0.2 * np.array([np.cos(1.0), np.sin(1.0)]), np.array([0.5, 0.0]), 0.35
    x = (0.45**2 - b**2 + (s := float(np.linalg.norm(d - a))) ** 2) / (2.0 * s)
    e = (d - a) / s
    top = a + x * e + np.sqrt(0.45**2 - x**2) * np.array([-e[1], e[0]])
    scene = {"bodies": {"crank": rod(0.2, 0.0 * a, a), "coupler": rod(0.45, a, top),
                        "rocker": rod(b, d, top)},
             "joints": {n: {"use": "revolute", "between": pair} for n, pair in {
                 "O": ["ground", "crank:a"], "A": ["crank:b", "coupler:a"],
                 "B": ["coupler:b", "rocker:b"], "D": ["rocker:a", "ground"]}.items()},
             "loads": {"g": {"use": "gravity"}}, "integrator": "generalized_alpha"}
    run, exact = (simulate(load({**scene, "time": {"end": 1.2, "step": h}})) for h in (0.02, 0.002))
    for name in ("crank.rigid", "coupler.rigid", "rocker.rigid"):
        right = exact.block(name)[::10]
        change = np.linalg.norm(right - right[0], axis=1).max()
        error = np.linalg.norm(run.block(name) - right, axis=1).max() / change
        assert 0.4 < run.summary["time_error"][name] / error < 2.5


@pytest.mark.full
def test_round_off_and_settling_of_warm_bars_are_no_motion() -> None:
    """Two clamped bars, one 100 K warmer than free of stress: joint forces are round-off of the
    7e4 N that its elements bear, and bodies settle within the first steps of 10 s."""
    bar: dict[str, Any] = {
        "use": "flexible", "mesh": {"use": "rectangle", "lower": [0.0, -0.01],
                                    "size": [0.1, 0.02], "divisions": [3, 1]}, "order": 2,
        "thickness": 0.01, "fields": ["elastic", "thermal"], "reference": {"clamp": "left"},
        "material": {"E": 7e10, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 200, "c": 900}}
    scene = {"bodies": {"a": {**bar, "initial_temperature": 393.15},
                        "b": {**bar, "pose": {"position": [0.1, 0.0]}}},
             "joints": {"g": {"use": "fixed", "between": ["ground", "a:left"]},
                        "w": {"use": "fixed", "between": ["a:right", "b:left"]}},
             "time": {"end": 250.0, "step": 10.0}, "reducer": "full"}
    for integrator in ("generalized_alpha", "bdf1"):
        run = simulate(load({**scene, "integrator": integrator}))
        assert run.summary["note_kinds"] == []


def test_levels_of_the_notes() -> None:
    def levels(notes: tuple[Note, ...]) -> list[str]:
        return [n.level.value for n in notes]

    assert levels(time_error_notes({"a": 0.009}, {"a": 0.04}, 0.1, 1)) == []
    assert levels(time_error_notes({"a": 0.02, "b": 0.0}, {}, 0.1, 1)) == ["information"]
    assert levels(time_error_notes({"a": 0.0}, {"a": 0.4}, 0.1, 1)) == ["information"]
    (note,) = time_error_notes({"a": 0.06, "b": 2.0}, {"a": 0.1}, 0.1, 2)
    assert note.kind == "time_error" and "b more than 100 %, a 6 %" in note.text
    assert "order 2" not in note.text
    assert levels(energy_notes(0.04, 0.1)) == levels(energy_notes(None, 0.1)) == []
    assert levels(energy_notes(0.07, 0.1)) == ["information"]
    assert levels(energy_notes(0.2, 0.1)) == ["warning"]
