"""Joint forces that alternate from step to step are noted, before the run and after it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import simulate
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.testing.in_memory_run import scene_of
from sparsemor.plugins.checks.unresolved_motion import alternation
from tiers import full


def links(out: Path, integrator: Any, joints: bool = True) -> RunResult:
    """Two rigid links that begin to swing with 3 rad/s, for 200 steps."""
    pose = {"angle": 0.7, "spin": 3.0}
    end = [np.cos(0.7), np.sin(0.7)]
    hung = {**pose, "position": end, "velocity": [-3.0 * end[1], 3.0 * end[0]]}
    link = {"use": "rigid", "mass": 1.0, "inertia": 0.02, "center": [0.5, 0.0],
            "points": {"a": [0.0, 0.0], "b": [1.0, 0.0]}}
    return simulate(scene_of({
        "bodies": {"one": {**link, "pose": pose}, "two": {**link, "pose": hung}},
        "joints": {"A": {"use": "revolute", "between": ["ground", "one:a"]},
                   "B": {"use": "revolute", "between": ["one:b", "two:a"]}} if joints else {},
        "loads": {"g": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": 0.2, "step": 1e-3}, "integrator": integrator}), out=out / "run")


def alpha(rho: float) -> dict[str, Any]:
    return {"use": "generalized_alpha", "rho_inf": rho}


@pytest.mark.full
def test_undamped_forces_are_noted_before_the_run_and_measured_after_it(tmp_path: Path) -> None:
    run = links(tmp_path, alpha(1.0))
    assert run.summary["note_kinds"] == ["undamped_forces", "alternating_forces"]
    before, *after = run.summary["notes"]
    assert "rho_inf = 1 hardly damps errors of joint forces (A, B)" in before and "0.95" in before
    shares = [alternation(run.block(f"{joint}.multiplier")[-22:]) for joint in "AB"]
    assert len(after) == 2 and max(shares) > 0.4
    for joint, share, text in zip("AB", shares, after, strict=True):
        assert f"joint {joint} alternate from step to step, by {100 * share:.3g} %" in text


@pytest.mark.parametrize(("integrator", "joints"), [
    full(alpha(0.95), True), full("bdf2", True), full(alpha(1.0), False)])
def test_damped_forces_and_free_bodies_are_not_noted(
    integrator: Any, joints: bool, tmp_path: Path
) -> None:
    assert set(links(tmp_path, integrator, joints).summary["note_kinds"]) <= {
        "stiff_in_bending"}


def test_the_share_is_the_amplitude_over_the_size() -> None:
    k = np.arange(22.0)
    states_along = np.stack([10.0 + 0.1 * k, np.cos(0.3 * k)], axis=1)
    assert alternation(states_along) == 0.0
    states_along[:, 1] += 2.0 * (-1.0) ** k
    assert alternation(states_along) == pytest.approx(2.0 / 12.1, rel=0.02)
    states_along[7, 1] += 9.0  # one jump is no alternation
    assert alternation(states_along) == 0.0
