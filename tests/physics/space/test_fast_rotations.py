"""Free frames in space that turn by up to one radian a step, against Euler's equations."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sparsemor import simulate
from sparsemor.bodies.frames import rotation as rot
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

MASS, LEVER, G = 1.0, 0.3, 9.81
TILT = rot.about([1.0, 0.0, 0.0], 0.5)
INTEGRATORS: dict[str, Any] = {
    "bdf2": "bdf2", **{f"alpha {r}": {"use": "generalized_alpha", "rho_inf": r}
                       for r in (0.5, 0.8, 0.95)}}
ROTOR = np.array([1.0, 1.6, 2.2]), np.array([6.0, 1.5, 8.0]), 2.4
TOP = np.array([0.11, 0.11, 0.01]), np.array([3.0, 0.0, 60.0]), 0.3
"""Moments about the origin, kg m2, angular velocity in body axes, rad/s, and end, s."""


def euler(moments: FloatArray, w: FloatArray, end: float, lever: float) -> FloatArray:
    """Quaternion and angular velocity at the end, by DOP853 with a tolerance of 1e-11."""
    def rate(t: float, y: FloatArray) -> FloatArray:
        p, w = y[:4], y[4:]
        torque = np.cross([0.0, 0.0, lever], rot.rotation(p).T @ [0.0, 0.0, -MASS * G])
        return np.concatenate([
            0.5 * rot.to_body(p).T @ w, (torque - np.cross(w, moments * w)) / moments])

    found = solve_ivp(rate, (0.0, end), np.concatenate([TILT, w]), method="DOP853", rtol=1e-11,
                      atol=1e-12)
    return np.asarray(found.y[:, -1])


def body(
    moments: FloatArray, w: FloatArray, end: float, turn: float, integrator: Any, lever: float
) -> March:
    """With steps in which the body turns by `turn`, rad; a lever: on a spherical joint."""
    steps = round(end * float(np.linalg.norm(w)) / turn)
    about = moments - MASS * lever**2 * np.array([1.0, 1.0, 0.0])
    top: dict[str, Any] = {} if lever == 0.0 else {
        "joints": {"foot": {"use": "spherical", "between": ["ground", "body:foot"]}},
        "loads": {"weight": {"use": "gravity", "g": [0.0, 0.0, -G]}}}
    return march(scene_of({
        "bodies": {"body": {
            "use": "rigid", "mass": MASS, "inertia": about.tolist(), "center": [0.0, 0.0, lever],
            "points": {"foot": [0.0, 0.0, 0.0]},
            "pose": {"axis": [1, 0, 0], "angle": 0.5, "spin": (rot.rotation(TILT) @ w).tolist()}}},
        "time": {"end": end, "step": end / steps}, "integrator": integrator, **top}))


def spin(x: FloatArray, v: FloatArray) -> FloatArray:
    return np.asarray(2.0 * rot.to_body(x[3:7]) @ v[3:7])


def error(got: March, want: FloatArray) -> float:
    """Angle between the attitudes, rad, and relative error of the rate: the larger one."""
    x, w = got.x[-1], want[4:]
    angle = 2.0 * np.arccos(min(abs(float(x[3:7] @ want[:4])), 1.0))
    return max(angle, float(np.linalg.norm(spin(x, got.v[-1]) - w) / np.linalg.norm(w)))


@pytest.mark.full
@pytest.mark.parametrize(("name", "of", "lever"), [
    ("bdf2", TOP, LEVER), ("alpha 0.5", ROTOR, 0.0), ("alpha 0.8", TOP, LEVER),
    ("alpha 0.95", ROTOR, 0.0)], ids=["bdf2 top", "0.5 rotor", "0.8 top", "0.95 rotor"])
def test_errors_fall_with_the_square_of_the_step(name: str, of: Any, lever: float) -> None:
    """At 0.4, 0.2 and 0.1 rad a step, attitude (rad) and rate; from 0.6 to 0.05 at least with the
    square of the step, within a third of it."""
    want = euler(*of, lever)
    worst, *errors, least = (error(body(*of, turn, INTEGRATORS[name], lever), want)
                             for turn in (0.6, 0.4, 0.2, 0.1, 0.05))
    assert errors[2] < 0.06
    assert errors[2] < errors[1] / 3.4 and errors[1] < errors[0] / 2.5
    assert least < 0.015 and least < worst / (0.3 * 12.0**2)


@pytest.mark.full
@pytest.mark.parametrize(("name", "turn", "lost"), [
    ("alpha 0.95", 0.1, 1e-5), ("alpha 0.95", 1.0, 1e-3), ("alpha 0.5", 0.3, 1e-2),
    ("bdf2", 0.3, 2e-2)])
def test_a_spin_about_a_principal_axis_stays(name: str, turn: float, lost: float) -> None:
    """100 rad/s over 100 steps: generalized_alpha landed on -p and stopped turning, from 0.1 rad a
    step on with rho_inf 0.95."""
    got = body(np.array([1.0, 1.0, 2.0]), np.array([0.0, 0.0, 100.0]), turn, turn,
               INTEGRATORS[name], 0.0)
    rates = np.array([spin(x, v) for x, v in zip(got.x, got.v, strict=True)])
    np.testing.assert_allclose(rates, [[0.0, 0.0, 100.0]] * len(rates), atol=100.0 * lost)


@pytest.mark.full
@pytest.mark.parametrize(("integrator", "step", "kinds", "words"), [
    ("bdf1", 1e-3, ["braked_spin"], "by about 11 % over the run"),
    ("bdf2", 1e-3, [], ""),
    ({"use": "generalized_alpha"}, 0.012, ["unresolved_rotation"], "by 1.16 rad in a step")])
def test_a_run_says_that_its_spin_is_braked_or_unresolved(
    integrator: Any, step: float, kinds: list[str], words: str
) -> None:
    """100 rad/s for 0.1 s: bdf1 keeps 1 / sqrt(1 + (w h)^2 / 4 n) = 0.894 of it in n = 100."""
    run = simulate(scene_of({
        "bodies": {"body": {"use": "rigid", "mass": 1.0, "inertia": [1.0, 1.0, 2.0],
                            "pose": {"spin": [0.0, 0.0, 100.0]}}},
        "time": {"end": 100 * step if step < 0.01 else 10 * step, "step": step},
        "integrator": integrator}))
    assert run.summary["note_kinds"] == kinds
    assert words in " ".join(run.summary["notes"])


@pytest.mark.slow
@pytest.mark.parametrize("rho", [0.5, 0.8, 0.95])
def test_a_tumbling_body_does_not_flip_in_1e5_steps(rho: float) -> None:
    """Half a radian a step: the angular velocity in space axes never reverses."""
    got = body(np.array([1.0, 1.6, 2.2]), np.array([1.0, 0.5, 8.0]), 6.2e3, 0.5,
               {"use": "generalized_alpha", "rho_inf": rho}, 0.0)
    assert len(got.t) > 1e5
    w = np.array([rot.rotation(x[3:7]) @ spin(x, v)
                  for x, v in zip(got.x, got.v, strict=True)])
    assert ((w[1:] * w[:-1]).sum(axis=1) > 0.0).all()
