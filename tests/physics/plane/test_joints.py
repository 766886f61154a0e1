"""Joints: reactions, imposed motion, welded bodies, and two ways to describe one body."""

from typing import Any

import numpy as np
import pytest

from joint_runs import run
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March

ROD = {"use": "rigid", "mass": 2.0, "inertia": 0.05, "center": [0.3, 0.1],
       "points": {"a": [0, 0], "b": [0.6, 0.0]}}
GRAVITY = {"gravity": {"use": "gravity", "g": [0.0, -9.81]}}


@pytest.mark.full
def test_imposed_motion_is_followed_and_its_force_is_the_inertia_force() -> None:
    move = {"use": "sine", "amplitude": 0.05, "frequency": 2.0}
    moving = {**ROD, "pose": {"velocity": [0.05 * 4 * np.pi, 0.0]}}
    got = run({"rod": moving}, {"drive": {
        "use": "prescribed_motion", "of": "rod:a", "x": move, "y": 0.0, "angle": 0.0}}, 0.15, 1e-3)
    w = 4 * np.pi
    x = got.block("rod.rigid")
    np.testing.assert_allclose(x[1:, 0], 0.05 * np.sin(w * got.t[1:]), rtol=0, atol=1e-12)
    assert np.abs(x[:, 1:]).max() < 1e-12
    pull = 2.0 * 0.05 * w**2 * np.sin(w * got.t)  # minus m x''
    late, bound = slice(50, None), 1e-3 * np.abs(pull).max()
    # the jump of x''' at the start disturbs the first forces: rho_inf = 0.8 forgets them
    force = got.block("drive.multiplier")[late]
    np.testing.assert_allclose(force[:, 0], pull[late], rtol=0, atol=bound)
    # the centre of mass is 0.1 m above the driven point, so a moment holds the angle
    np.testing.assert_allclose(force[:, 2], -0.1 * pull[late], rtol=0, atol=bound)


def test_imposed_rotation_turns_at_the_given_rate_about_the_driven_point() -> None:
    turn = {"use": "ramp", "end": 10.0, "final": 30.0}  # 3 rad/s
    spinning = {**ROD, "pose": {"spin": 3.0}}
    got = run({"rod": spinning}, {"drive": {
        "use": "prescribed_motion", "of": "rod:a", "x": 0.0, "y": 0.0, "angle": turn}}, 0.05, 1e-3)
    theta = got.block("rod.rigid")[:, 2]
    np.testing.assert_allclose(theta, 3.0 * got.t, rtol=0, atol=1e-12)
    force = got.block("drive.multiplier")
    pull = 2.0 * 9.0 * (0.3 + 0.1j) * np.exp(1j * theta)  # m w^2 r, outwards
    np.testing.assert_allclose(force[:, 0] + 1j * force[:, 1], pull, rtol=0, atol=1e-6)


def test_a_hanging_chain_carries_its_weight() -> None:
    """At rest under bdf1 with long steps: each hinge carries what hangs below it."""
    down = {"angle": -np.pi / 2}
    link = {**ROD, "center": [0.3, 0.0]}
    got = run({"one": {**link, "pose": down},
               "two": {**link, "mass": 3.0, "pose": {**down, "position": [0.0, -0.6]}}},
              {"A": {"use": "revolute", "between": ["ground", "one:a"]},
               "B": {"use": "revolute", "between": ["one:b", "two:a"]}}, 1.0, 0.1, GRAVITY, "bdf1")
    np.testing.assert_allclose(got.block("A.multiplier")[-1], [0.0, -5.0 * 9.81], atol=1e-9)
    np.testing.assert_allclose(got.block("B.multiplier")[-1], [0.0, 3.0 * 9.81], atol=1e-9)


@pytest.mark.full
def test_two_welded_rigid_bodies_are_one() -> None:
    """Up to the error of the time steps, which depends on the coordinates."""
    half = {"use": "rigid", "mass": 1.0, "inertia": 0.02, "center": [0.2, 0.0],
            "points": {"a": [0, 0], "b": [0.4, 0.0]}}
    two = run({"one": half, "two": {**half, "mass": 3.0, "pose": {"position": [0.4, 0.0],
                                                                  "angle": 0.7}}},
              {"A": {"use": "revolute", "between": ["ground", "one:a"]},
               "B": {"use": "fixed", "between": ["one:b", "two:a"]}}, 1.0, 1e-3, GRAVITY)
    far = 0.4 + 0.2 * np.exp(0.7j)
    center = (1.0 * 0.2 + 3.0 * far) / 4.0
    inertia = 0.04 + abs(0.2 - center) ** 2 + 3.0 * abs(far - center) ** 2
    one = run({"both": {"use": "rigid", "mass": 4.0, "inertia": float(inertia),
                        "center": [float(center.real), float(center.imag)],
                        "points": {"a": [0, 0]}}},
              {"A": {"use": "revolute", "between": ["ground", "both:a"]}}, 1.0, 1e-3, GRAVITY)
    angle = one.block("both.rigid")[:, 2]
    assert np.ptp(angle) > 2.0
    np.testing.assert_allclose(two.block("one.rigid")[:, 2], angle, rtol=0, atol=2e-5)
    weld = two.block("two.rigid")[:, 2] - two.block("one.rigid")[:, 2]
    np.testing.assert_allclose(weld, 0.7, rtol=0, atol=1e-12)
    force = np.abs(one.block("A.multiplier")).max()
    np.testing.assert_allclose(two.block("A.multiplier"), one.block("A.multiplier"),
                               rtol=0, atol=1e-4 * force)


def beam(length: float, columns: int, modulus: float = 7e8, **pose: Any) -> dict[str, Any]:
    return {"use": "flexible", "thickness": 0.03, "fields": ["elastic"],
            "mesh": {"use": "rectangle", "lower": [0.0, -0.05], "size": [length, 0.1],
                     "divisions": [columns, 4]},
            "material": {"E": modulus, "nu": 0.0, "rho": 1000}, "reference": {"clamp": "left"},
            "damping": {"stiffness": 1e-4}, "pose": pose}


def tip(got: March, name: str) -> FloatArray:
    """Mean displacement of the body's right end in space axes, from its start, (M, 2)."""
    body: Any = got.model.parts[name]
    u = np.zeros((len(got.t), 2 * len(body.X)))
    u[:, body.elasticity.free] = got.block(f"{name}.elastic")
    weights = body.centre_of("right", body.points["right"]).weights
    y, z = got.block(f"{name}.rigid"), (body.X @ [1, 1j] + u.view(complex)) @ weights
    place = y[:, 0] + 1j * y[:, 1] + np.exp(1j * y[:, 2]) * z
    return np.stack([(place - place[0]).real, (place - place[0]).imag], axis=1)


@pytest.mark.full
def test_two_welded_beams_bend_as_one() -> None:
    """The weld joins mean position and mean rotation of two cross-sections, as beam theory does."""
    ground = {"use": "fixed", "between": ["ground", "one:left"]}
    whole = run({"one": beam(1.0, 20)}, {"A": ground}, 0.5, 5e-3, GRAVITY)
    parts = run({"one": beam(0.5, 10), "two": beam(0.5, 10, position=[0.5, 0.0])},
                {"A": ground, "B": {"use": "fixed", "between": ["one:right", "two:left"]}},
                0.5, 5e-3, GRAVITY)
    bent = tip(whole, "one")
    assert np.abs(bent).max() > 1e-3
    np.testing.assert_allclose(tip(parts, "two"), bent, rtol=0, atol=0.01 * np.abs(bent).max())


def test_imposed_motion_of_a_flexible_body_moves_the_mean_of_the_set() -> None:
    move = {"use": "sine", "amplitude": 0.01, "frequency": 3.0}
    got = run({"one": beam(0.5, 10)}, {
        "A": {"use": "fixed", "between": ["ground", "one:left"]},
        "drive": {"use": "prescribed_motion", "of": "one:right", "y": move}}, 0.05, 1e-3)
    np.testing.assert_allclose(tip(got, "one")[1:, 1], 0.01 * np.sin(6 * np.pi * got.t[1:]),
                               rtol=0, atol=1e-12)
