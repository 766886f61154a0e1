"""Rotational springs in space that turn by more than pi."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load_model, reduce, simulate
from sparsemor.core import SolveFailed, Status
from sparsemor.core.testing.in_memory_run import scene_of

AXES = {"z": [0.0, 0.0, 1.0], "oblique": [2.0, -1.0, 2.0]}


def body(spin: list[float], frame: str = "floating") -> dict[str, Any]:
    return {"use": "rigid", "mass": 1.0, "inertia": [0.1, 0.1, 0.1], "frame": frame,
            "points": {"o": [0.0, 0.0, 0.0]}, "pose": {"spin": spin}}


def swinging(
    spin: float, axis: str = "z", frame: str = "floating", two: bool = False,
    reducer: str | dict[str, str] = "full", **spring: float,
) -> Any:
    """A body, or two that turn against each other, on a spring with w = sqrt(40) 1/s for 1 s; its
    relative angle is spin / w sin(w t)."""
    n = np.array(AXES[axis]) / np.linalg.norm(AXES[axis])
    rates = {"b": 0.5 * spin, "c": -0.5 * spin} if two else {"b": spin}
    bodies = {name: body((rate * n).tolist(), frame) for name, rate in rates.items()}
    return scene_of({
        "bodies": bodies, "time": {"end": 1.0, "step": 4e-3},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8}, "reducer": reducer,
        "joints": {"s": {"use": "rotational_spring", "axis": n.tolist(),
                         "between": ["b:o", "c:o" if two else "ground"],
                         "stiffness": 2.0 if two else 4.0, **spring}}})


def end(spin: float) -> float:
    return float(spin / np.sqrt(40.0) * np.sin(np.sqrt(40.0)))


def largest(spin: float) -> float:
    """Largest moment over the run, N m per unit stiffness."""
    return float(spin / np.sqrt(40.0))


@pytest.mark.full
@pytest.mark.parametrize(("axis", "two", "method"), [
    ("oblique", False, "newton"), ("oblique", True, "bordered")])
def test_a_spring_turns_by_more_than_pi(axis: str, two: bool, method: str) -> None:
    """20 rad/s: up to 3.162 rad, 0.131 rad at the end; with an angle between -pi and pi the spring
    pushed on, to 14 rad."""
    result = simulate(swinging(20.0, axis, two=two, reducer={"use": "full", "method": method}))
    angle = result.joint_forces()["s"]["torque", "N m"] / (-2.0 if two else -4.0)
    assert largest(20.0) > np.pi
    assert angle[-1] == pytest.approx(end(20.0), abs=0.02)
    assert np.abs(angle).max() == pytest.approx(largest(20.0), rel=2e-3)
    assert result.summary["notes"] == []


@pytest.mark.full
def test_spinning_frames_count_all_turns() -> None:
    """60 rad/s: up to 9.49 rad."""
    result = simulate(swinging(60.0, frame="spinning", two=True))
    angle = result.joint_forces()["s"]["torque", "N m"] / -2.0
    assert angle[-1] == pytest.approx(end(60.0), abs=0.06)
    assert np.abs(angle).max() == pytest.approx(largest(60.0), rel=2e-3)


@pytest.mark.full
@pytest.mark.parametrize("order, method", [
    (["b:o", "c:o"], "newton"), (["c:o", "b:o"], "bordered")])
def test_a_spinning_and_a_free_body_that_turn_together_hardly_load_their_spring(
    order: list[str], method: str
) -> None:
    """Two turns and a half at 30 rad/s; the free one is 1 rad/s faster."""
    scene = scene_of({
        "bodies": {"b": body([0.0, 0.0, 30.0], "spinning"), "c": body([0.0, 0.0, 31.0])},
        "joints": {"s": {"use": "rotational_spring", "axis": AXES["z"], "between": order,
                         "stiffness": 2.0}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "reducer": {"use": "full", "method": method}, "time": {"end": 0.5, "step": 1e-3}})
    moment = simulate(scene).joint_forces()["s"]["torque", "N m"]
    assert np.abs(moment).max() == pytest.approx(2.0 / np.sqrt(40.0), rel=5e-3)


@pytest.mark.full
def test_a_position_drive_goes_through_many_turns() -> None:
    """A wheel driven through five turns about an oblique axis: the deflection is that of spinning
    frames, and of theory at the end, where the drive stands still."""
    drive: Any = {"stiffness": 40.0, "damping": 2.0, "angle": {
        "use": "smooth_step", "start": 0.0, "end": 0.6, "initial": 0.0, "final": 10.0 * np.pi}}
    one, other = (simulate(swinging(0.0, axis, frame, **drive).using(
        {"time.end": 0.8, "time.step": 1e-3})).joint_forces()["s"]["torque", "N m"]
                  for axis, frame in (("oblique", "floating"), ("z", "spinning")))
    assert np.abs(one).max() > 20.0
    assert np.abs(one - other).max() < 0.02 * np.abs(one).max()
    assert abs(one[-1]) < 0.05 * np.abs(one).max()


@pytest.mark.full
def test_a_run_ends_where_a_spring_has_turned_too_far_to_be_counted() -> None:
    """60 rad/s: 9.49 sin(w t) = 2 pi at t = 0.1143 s."""
    words = "deflected by -6.[34].* rad.*frame: spinning"
    with pytest.raises(SolveFailed, match=words) as found:
        simulate(swinging(-60.0, "oblique"))
    assert found.value.status is Status.OUTSIDE_THEORY
    assert found.value.block == "s"
    assert found.value.time == pytest.approx(
        np.arcsin(2.0 * np.pi / largest(60.0)) / np.sqrt(40.0), abs=3e-3)


@pytest.mark.full
def test_a_damper_without_stiffness_counts_no_turns() -> None:
    """Damping 0.1 N m s/rad on 0.1 kg m^2 from 60 rad/s: 37.9 rad in 1 s, 22.1 rad/s at the end."""
    result = simulate(swinging(60.0, "oblique", stiffness=0.0, damping=0.1))
    moment = result.joint_forces()["s"]["torque", "N m"]
    assert moment[-1] == pytest.approx(-6.0 * np.exp(-1.0), rel=5e-3)


@pytest.mark.full
def test_kept_models_and_resumed_runs_of_a_flexible_body_count_alike(tmp_path: Path) -> None:
    """A hinged bar at 30 rad/s turns by 4.77 rad as a rigid one, A = spin sqrt(J / k) with J =
    0.2524 kg m^2; at 60 rad/s by more than 2 pi."""
    def bar(spin: float) -> Any:
        return scene_of({
            "bodies": {"bar": {
                "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
                "mesh": {"use": "block", "size": [0.5, 0.1, 0.06], "divisions": [2, 1, 1]},
                "material": {"E": 1e9, "nu": 0.3, "rho": 1000},
                "pose": {"spin": [0.0, 0.0, spin], "velocity": [0.05 * spin, 0.0, 0.0]}}},
            "joints": {
                "hinge": {"use": "revolute", "between": ["ground", "bar:left"], "axis": AXES["z"]},
                "s": {"use": "rotational_spring", "between": ["bar:left", "ground"],
                      "axis": AXES["z"], "stiffness": 10.0}},
            "reducer": {"use": "galerkin", "basis": {"use": "modal", "count": 6}},
            "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
            "time": {"end": 0.3, "step": 2e-3}, "training": {"end": 0.15}})

    runs = []
    for spin in (30.0, 60.0):
        reduce(bar(spin)).save(tmp_path / "model")
        runs.append(load_model(tmp_path / "model"))
    moment = runs[0].run().joint_forces()["s"]["torque", "N m"]
    angle = moment / -10.0
    assert angle.max() == pytest.approx(30.0 * np.sqrt(0.02524), rel=5e-3)
    simulate(bar(30.0).using({"time.end": 0.15}), out=tmp_path / "run")  # from 3.9 rad on
    again = simulate(bar(30.0), out=tmp_path / "run", resume=True)
    straight = simulate(bar(30.0)).joint_forces()["s"]["torque", "N m"]
    np.testing.assert_array_equal(again.joint_forces()["s"]["torque", "N m"], straight)
    np.testing.assert_allclose(straight, moment, rtol=0, atol=1e-9)
    with pytest.raises(SolveFailed, match=r"in s \(the spring is deflected by 6\.3"):
        runs[1].run()
