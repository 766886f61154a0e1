"""Loads that jump within a time step: the numbers of the note are those of the run, and resolved
functions have no note."""

from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.core.simulation.diagnostics.unresolved_jumps import unresolved_jump
from sparsemor.plugins.functions import Constant, Pulse, Ramp, Sine, SmoothStep, Table

H, STEPS = 1e-3, 100


def pushed(function: dict[str, Any]) -> tuple[float, list[str]]:
    """Momentum that a body of 2 kg has after a push, and the notes of the run."""
    run = simulate(load({
        "format": 1,
        "bodies": {"ball": {"use": "rigid", "mass": 2.0, "inertia": 0.1,
                            "points": {"middle": [0.0, 0.0]}}},
        "loads": {"push": {"use": "point_force", "on": "ball:middle", "force": [1.0, 0.0],
                           "factor": function}},
        "probes": {"ball": {"body": "ball", "at": "middle"}},
        "time": {"end": 0.03, "step": H}, "integrator": "bdf1", "reducer": "full"}))
    x = run.probe("ball")[:, 0]
    return 2.0 * float(x[-1] - x[-2]) / H, list(run.summary["notes"])


@pytest.mark.parametrize(("start", "duration"), [(0.0103, 1.5e-3), (0.0109, 0.2e-3)])
def test_the_note_has_the_impulse_of_the_run(start: float, duration: float) -> None:
    momentum, notes = pushed({"use": "pulse", "start": start, "duration": duration, "level": 5.0})
    (note,) = notes
    assert note.startswith(f"loads.push.factor changes within steps of 0.001 s: its integral over "
                           f"the run is {5.0 * duration:.4g}, ")
    assert f"times the step, {momentum:.4g}; " in note


def test_a_pulse_of_whole_steps_has_its_impulse_and_no_note() -> None:
    momentum, notes = pushed({"use": "pulse", "start": 0.0105, "duration": 4e-3, "level": 5.0})
    assert momentum == pytest.approx(0.02)
    assert notes == []


def test_a_table_that_jumps_is_found() -> None:
    table = Table(times=(0.01, 0.0105, 0.0106, 0.0115), values=(0.0, 1.0, 1.0, 0.0))
    note = unresolved_jump("f", table, STEPS, H)
    assert note is not None
    assert "the run is 0.0008, and the sum of its values at the steps, times the step" in note.text


RNG = np.random.default_rng(0)
RESOLVED = {
    "a step that stays": Pulse(start=0.0103, duration=1.0, level=1.0),
    "a steep ramp that stays": Ramp(start=0.0103, end=0.0104, final=1.0),
    "a huge constant": Constant(level=1e308),
    "a slow ramp": Ramp(end=0.1, final=1.0),
    "a smooth step": SmoothStep(start=0.01, end=0.02, final=-1.0),
    "a sine": Sine(amplitude=1.0, frequency=0.0103),
    "six steps per period": Sine(amplitude=1.0, frequency=170.0, phase=0.3),
    "a pulse of 20 steps": Pulse(start=0.0103, duration=0.02, level=-2.0),
    "a table with many times": Table(
        times=tuple(np.linspace(0.0, 0.1, 777)), values=tuple(np.sin(np.linspace(0.0, 30.0, 777)))),
    "a rough table": Table(times=tuple(np.linspace(0.0, 0.1, 15)),
                           values=tuple(RNG.standard_normal(15))),
}


@pytest.mark.parametrize("function", RESOLVED.values(), ids=list(RESOLVED))
def test_resolved_functions_have_no_note(function: Any) -> None:
    assert unresolved_jump("f", function, STEPS, H) is None
