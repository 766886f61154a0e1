"""Stops, friction, bushings, gears, racks and universal joints against closed forms, in the plane
and in space."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from sparsemor import load, load_model, reduce, simulate
from sparsemor.core import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.testing import check_joint
from sparsemor.core.testing.in_memory_run import scene_of
from tiers import full

G = 9.81
PLANE = {"use": "rigid", "mass": 2.0, "inertia": 0.02, "points": {"p": [0.0, 0.0]}}
SPACE = {"use": "rigid", "mass": 2.0, "inertia": [0.02, 0.03, 0.02],
         "points": {"p": [0.0, 0.0, 0.0]}}
Z = [0.0, 0.0, 1.0]


def turned(dimension: int, angle: float = 0.0, rate: float = 0.0, **more: Any) -> dict[str, Any]:
    """A body at an angle (about z), with a rate."""
    if dimension == 2:
        pose: dict[str, Any] = {"angle": angle, "spin": rate}
        return {**PLANE, "pose": pose, **more}
    pose = {"axis": Z, "angle": angle, "spin": [0.0, 0.0, rate]}
    return {**SPACE, "pose": pose, **more}


def axis(dimension: int, e: Any = Z) -> dict[str, Any]:
    return {} if dimension == 2 else {"axis": e}


def scene(bodies: Any, joints: Any, end: float, step: float, **more: Any) -> dict[str, Any]:
    return {"format": 1, "bodies": bodies, "joints": joints, "time": {"end": end, "step": step},
            "integrator": {"use": "generalized_alpha", "rho_inf": 0.9}, **more}


def angle(x: FloatArray) -> FloatArray:
    """Angles (T,) about z of rigid coordinates."""
    if x.shape[1] == 3:
        return x[:, 2]
    return np.unwrap(2.0 * np.arctan2(x[:, 6], x[:, 3]))


# ---------------------------------------------------------------------- friction


@pytest.mark.full
@pytest.mark.parametrize("dimension", [2, 3])
def test_time_to_rest_of_a_torsional_pendulum(dimension: int) -> None:
    """With the moment M the amplitudes decrease by 2 M / k each half period, until |angle| < M / k:
    1, 0.7, 0.4, 0.1 after 3 half periods."""
    k, J, M = 8.0, 0.02, 1.2
    run = simulate(load(scene(
        {"b": turned(dimension, 1.0)},
        {"pin": {"use": "revolute", "between": ["ground", "b:p"], **axis(dimension)},
         "spring": {"use": "rotational_spring", "between": ["b:p", "ground"], "stiffness": k,
                    "angle": -1.0, **axis(dimension)},
         "friction": {"use": "joint_friction", "between": ["b:p", "ground"], "force": M,
                      **axis(dimension)}}, 0.6, 1e-3)))
    q, t = angle(run.block("b.rigid")), run.times
    rate = np.gradient(q, t)
    rest = t[np.flatnonzero(np.abs(rate) > 1e-2)[-1]]
    assert rest == pytest.approx(3 * np.pi * np.sqrt(J / k), rel=0.01)
    assert q[-1] == pytest.approx(-0.1 * 1.0 + 0.0, abs=2e-3)
    energy = 0.5 * J * rate**2 + 0.5 * k * q**2
    assert (np.diff(energy[2:-2:20]) < 1e-6).all()
    moment = run.joint_forces()["friction"]["torque", "N m"]
    assert float(np.abs(moment).max()) == pytest.approx(M)
    assert float(moment[-1]) == pytest.approx(k * q[-1], rel=1e-2)  # it holds the spring


@pytest.mark.full
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_wheel_on_a_pin_comes_to_rest(dimension: int) -> None:
    """The weight W presses the pin with the radius r: time w J / (mu r W)."""
    mu, r, w = 0.2, 0.05, 2.0
    g = [0.0, -G] if dimension == 2 else [0.0, -G, 0.0]
    run = simulate(load(scene(
        {"b": turned(dimension, rate=w)},
        {"pin": {"use": "revolute", "between": ["ground", "b:p"], **axis(dimension)},
         "friction": {"use": "joint_friction", "between": ["b:p", "ground"], "joint": "pin",
                      "coefficient": mu, "radius": r, **axis(dimension)}},
        0.3, 1e-3, loads={"weight": {"use": "gravity", "g": g}})))
    rate = np.gradient(angle(run.block("b.rigid")), run.times)
    rest = run.times[np.flatnonzero(rate > 1e-2)[-1]]
    assert rest == pytest.approx(w * 0.02 / (mu * r * 2.0 * G), rel=0.01)


@pytest.mark.full
@pytest.mark.parametrize("integrator, reducer", [
    ("bdf2", "galerkin"), full("generalized_alpha", "full")])
def test_friction_of_joint_forces_acts_from_the_start(integrator: str, reducer: str) -> None:
    """A wheel that spins down with mu r W / J: exact with integrators of second order."""
    mu, r, w = 0.2, 0.05, 2.0
    run = simulate(load(scene(
        {"b": turned(2, rate=w)},
        {"pin": {"use": "revolute", "between": ["ground", "b:p"]},
         "friction": {"use": "joint_friction", "between": ["b:p", "ground"], "joint": "pin",
                      "coefficient": mu, "radius": r}},
        0.1, 1e-2, loads={"weight": {"use": "gravity", "g": [0.0, -G]}}) | {
            "integrator": integrator, "reducer": reducer}))
    q = angle(run.block("b.rigid"))
    assert q[-1] - q[0] == pytest.approx(w * 0.1 - 0.5 * mu * r * 2.0 * G / 0.02 * 0.1**2, rel=1e-9)


@pytest.mark.full
@pytest.mark.parametrize("dimension, mu", [(2, 0.3), (3, 0.7)])
def test_a_slider_on_a_slope(dimension: int, mu: float) -> None:
    """On a slope of 30 degrees it slides with g (sin - mu cos), and sticks from mu = tan on."""
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    down = [-c, -s] if dimension == 2 else [-c, -s, 0.0]
    g = [0.0, -G] if dimension == 2 else [0.0, -G, 0.0]
    run = simulate(load(scene(
        {"b": turned(dimension)},
        {"guide": {"use": "prismatic", "between": ["b:p", "ground"], "axis": down},
         "friction": {"use": "joint_friction", "motion": "slide", "between": ["b:p", "ground"],
                      "axis": down, "joint": "guide", "coefficient": mu}},
        0.5, 1e-3, loads={"weight": {"use": "gravity", "g": g}})))
    way = run.block("b.rigid")[-1, : dimension] @ down
    expected = max(0.5 * G * (s - mu * c) * 0.5**2, 0.0)
    assert way == pytest.approx(expected, rel=0.01, abs=5e-5)


# ---------------------------------------------------------------------- stops


def restitution(D: float) -> float:
    """D (1 + e) = ln((1 + D) / (1 - e D))."""
    return float(brentq(
        lambda e: D * (1 + e) - np.log((1 + D) / (1 - e * D)), 0.0, min(1.0, 1 / D) - 1e-12))


@pytest.mark.full
@pytest.mark.parametrize("dimension, damping", [(2, 0.3), (3, 0.0)])
def test_a_turning_body_leaves_a_stop_with_the_restitution(
    dimension: int, damping: float
) -> None:
    w = 2.0
    run = simulate(load(scene(
        {"b": turned(dimension, rate=w)},
        {"pin": {"use": "revolute", "between": ["ground", "b:p"], **axis(dimension)},
         "stop": {"use": "stop", "between": ["b:p", "ground"], "upper": 0.1, "lower": -5.0,
                  "stiffness": 200.0, "damping": damping, **axis(dimension)}},
        0.15, 5e-4)))
    rate = np.gradient(angle(run.block("b.rigid")), run.times)
    e = restitution(damping * w) if damping else 1.0
    assert rate[-3] == pytest.approx(-e * w, rel=5e-3)


@pytest.mark.full
def test_impacts_that_the_steps_do_not_resolve_are_noted() -> None:
    """pi sqrt(J / k) is 14 steps, or one."""
    for stiffness, noted in ((1e3, False), (1e5, True)):
        run = simulate(load(scene(
            {"b": turned(2, rate=2.0)},
            {"pin": {"use": "revolute", "between": ["ground", "b:p"]},
             "stop": {"use": "stop", "between": ["b:p", "ground"], "upper": 0.1,
                      "stiffness": stiffness}}, 0.1, 1e-3)))
        notes = [n for n in run.summary["notes"] if n.startswith("stop acts for")]
        assert bool(notes) is noted


@pytest.mark.full
@pytest.mark.parametrize("dimension, swapped", [(2, True), (3, False)])
def test_a_slider_between_stops(dimension: int, swapped: bool) -> None:
    """It leaves both with its speed, after the half period pi sqrt(m / k) of the contact."""
    e = [0.6, 0.8] if dimension == 2 else [0.6, 0.0, 0.8]
    body = turned(dimension)
    body["pose"] = {"velocity": [3.0 * x for x in e]}
    between = ["ground", "b:p"] if swapped else ["b:p", "ground"]
    limits = {"lower": -0.2, "upper": 0.3} if not swapped else {"lower": -0.3, "upper": 0.2}
    run = simulate(load(scene(
        {"b": body},
        {"guide": {"use": "prismatic", "between": ["b:p", "ground"], "axis": e},
         "stop": {"use": "stop", "motion": "slide", "between": between, "axis": e, **limits,
                  "stiffness": 2e4}}, 0.4, 4e-4)))
    way = run.block("b.rigid")[:, : dimension] @ e
    deep = 3.0 * np.sqrt(2.0 / 2e4)
    assert way.max() == pytest.approx(0.3 + deep, rel=1e-3)
    assert way.min() == pytest.approx(-0.2 - deep, rel=1e-3)
    contact = np.pi * np.sqrt(2.0 / 2e4)
    assert run.times[way > 0.3].size * 4e-4 == pytest.approx(contact, rel=0.02)


# ---------------------------------------------------------------------- bushing


@pytest.mark.full
@pytest.mark.parametrize("dimension", [2, 3])
def test_frequencies_of_a_bushing(dimension: int) -> None:
    """Each direction vibrates on its own: sqrt(k / m) and sqrt(k / J)."""
    d = dimension
    k = [2000.0, 4000.0, 3000.0][:d]
    turning = [4.0] if d == 2 else [8.0, 6.0, 4.0]
    body = turned(d)
    body["pose"] = {"velocity": [0.01, 0.02, -0.01][:d],
                    "spin": 0.01 if d == 2 else [0.01, -0.02, 0.01]}
    run = simulate(load(scene({"b": body}, {"mount": {
        "use": "bushing", "between": ["b:p", "ground"], "stiffness": k,
        "turning_stiffness": turning}}, 0.3, 5e-4)))
    x, t = run.block("b.rigid"), run.times
    for i, v in enumerate([0.01, 0.02, -0.01][:d]):
        w = np.sqrt(k[i] / 2.0)
        np.testing.assert_allclose(x[:, i], v / w * np.sin(w * t), atol=2e-3 * abs(v / w) + 1e-9)
    J = [0.02, 0.03, 0.02]
    w = np.sqrt(turning[-1] / J[-1])
    np.testing.assert_allclose(angle(x), 0.01 / w * np.sin(w * t), atol=5e-3 * 0.01 / w)


# ---------------------------------------------------------------------- gears


@pytest.mark.full
@pytest.mark.parametrize("dimension, internal", [(2, False), (3, True)])
def test_a_gear_accelerates_by_the_reduced_inertia(dimension: int, internal: bool) -> None:
    """phi_1'' = M / (J + J (z_1 / z_2)^2), through several turns."""
    between = {"use": "revolute", **axis(dimension)}
    other = turned(dimension)
    other["pose"] = {"position": [0.3, 0.0, 0.0][:dimension]}
    torque = {"torque": 1.5} if dimension == 2 else {"torque": [0.0, 0.0, 1.5]}
    run = simulate(load(scene(
        {"a": turned(dimension), "b": other},
        {"one": {**between, "between": ["ground", "a:p"]},
         "two": {**between, "between": ["ground", "b:p"]},
         "gear": {"use": "gear", "between": ["a:p", "b:p"], "teeth": [20, 30],
                  "internal": internal, **axis(dimension)}},
        0.8, 2e-3, loads={"motor": {"use": "torque", "on": "a:p", **torque}})))
    one, two = angle(run.block("a.rigid")), angle(run.block("b.rigid"))
    expected = 0.5 * 1.5 / (0.02 * (1.0 + (20 / 30) ** 2)) * 0.8**2
    assert one[-1] == pytest.approx(expected, rel=2e-3)
    np.testing.assert_allclose(two, (1 if internal else -1) * 20 / 30 * one, atol=1e-8)


@pytest.mark.full
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_rack_moves_with_its_pinion(dimension: int) -> None:
    """x'' = M / r / (m + J / r^2)."""
    e, r = [0.6, 0.8, 0.0][:dimension], 0.1
    torque = {"torque": 1.5} if dimension == 2 else {"torque": [0.0, 0.0, 1.5]}
    rack = turned(dimension)
    rack["pose"] = {"position": [0.0, 0.1, 0.0][:dimension]}
    run = simulate(load(scene(
        {"a": turned(dimension), "b": rack},
        {"pin": {"use": "revolute", "between": ["ground", "a:p"], **axis(dimension)},
         "guide": {"use": "prismatic", "between": ["b:p", "ground"], "axis": e},
         "rack": {"use": "rack", "between": ["a:p", "b:p"], "radius": r, "direction": e,
                  **axis(dimension)}},
        0.8, 2e-3, loads={"motor": {"use": "torque", "on": "a:p", **torque}})))
    x = run.block("b.rigid")[:, : dimension] @ e
    way = x - x[0]
    assert way[-1] == pytest.approx(0.5 * 1.5 / r / (2.0 + 0.02 / r**2) * 0.8**2, rel=2e-3)
    np.testing.assert_allclose(way, r * angle(run.block("a.rigid")), atol=1e-8)
    force = run.joint_forces()["rack"]["force", "N"]
    assert -force[-1] == pytest.approx(2.0 * 1.5 / r / (2.0 + 0.02 / r**2), rel=1e-3)


@pytest.mark.full
def test_a_universal_joint_turns_by_the_law_of_cardan() -> None:
    """tan(angle_2) = tan(angle_1) / cos b for shafts at an angle b."""
    b = 0.5
    shaft = [0.0, -np.sin(b), np.cos(b)]
    run = simulate(load(scene(
        {"one": {**SPACE, "frame": "spinning"}, "two": SPACE},
        {"cross": {"use": "universal", "between": ["one:p", "two:p"], "axis": [1.0, 0.0, 0.0],
                   "second_axis": [0.0, np.cos(b), np.sin(b)]},
         "hold": {"use": "revolute", "between": ["two:p", "ground"], "axis": shaft}},
        1.0, 5e-3, loads={"motor": {"use": "torque", "on": "one:p", "torque": [0.0, 0.0, 0.2]}})))
    one, q = run.block("one.rigid")[:, 3], run.block("two.rigid")[:, 3:]
    two = np.unwrap(2 * np.arctan2(q[:, 1:] @ shaft, q[:, 0]))
    assert one[-1] > 2.0
    # the fork of the first shaft starts normal to the plane of both
    np.testing.assert_allclose(
        two, np.unwrap(np.arctan2(np.sin(one) * np.cos(b), np.cos(one))), atol=1e-6)


# ---------------------------------------------------------------------- flexible sides


def swing(dimension: int, reducer: Any) -> dict[str, Any]:
    """A flexible bar that swings against a stop, with friction in its pin."""
    d = dimension
    mesh = {"use": "rectangle", "size": [0.4, 0.04], "divisions": [8, 1]} if d == 2 else {
        "use": "block", "size": [0.4, 0.04, 0.04], "divisions": [4, 1, 1]}
    bar = {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
           "material": {"rho": 2700, "E": 7e8, "nu": 0.3}, "mesh": mesh,
           "damping": {"stiffness": 1e-4}, **({"thickness": 0.04} if d == 2 else {})}
    about = axis(d)
    friction = {"use": "joint_friction", "between": ["bar:left", "ground"], "joint": "pin",
                "coefficient": 0.2, "radius": 0.02, "critical_rate": 1e-2, **about}
    stop = {"use": "stop", "between": ["bar:left", "ground"], "lower": -0.3, "stiffness": 200.0,
            "damping": 0.1, **about}
    return scene({"bar": bar}, {
        "pin": {"use": "revolute", "between": ["bar:left", "ground"], **about},
        "friction": friction, "stop": stop}, 0.3, 2e-3, reducer=reducer,
        loads={"weight": {"use": "gravity", "g": [0.0, -G, 0.0][:d]}},
        probes={"tip": {"body": "bar", "at": "right"}})


@pytest.mark.full
@pytest.mark.parametrize("dimension", [2, 3])
def test_stop_and_friction_of_a_flexible_bar_in_reduced_and_kept_models(
    dimension: int, tmp_path: Any
) -> None:
    want = simulate(scene_of(swing(dimension, "full"))).probe("tip")
    size = float(np.ptp(want[:, 1]))
    assert want[-1, 1] > want[:, 1].min() + 1e-3  # it came back from the stop
    for use in ("sparse", "deim") if dimension == 2 else ("ecsw",):
        run = simulate(scene_of(swing(dimension, {"use": use, "compiled": "off"}))).probe("tip")
        np.testing.assert_allclose(run[:, :2], want[:, :2], atol=5e-3 * size, err_msg=use)
    model = reduce(scene_of(swing(dimension, {"use": "galerkin", "compiled": "off"})))
    model.save(tmp_path / "model")
    again = load_model(tmp_path / "model").run().probe("tip")
    np.testing.assert_allclose(again, model.run().probe("tip"), rtol=0.0, atol=1e-12 * size)


@pytest.mark.slow  # compiles
def test_compiled_steps_of_stop_and_friction() -> None:
    off, on = (simulate(scene_of(swing(2, {"use": "galerkin", "compiled": c}))).probe("tip")
               for c in ("off", "on"))
    np.testing.assert_allclose(on, off, rtol=0.0, atol=1e-7)


# ---------------------------------------------------------------------- laws and input

LAWS: dict[str, tuple[dict[str, Any], tuple[int, ...]]] = {
    "stop": ({"use": "stop", "upper": 0.3, "lower": -0.2, "stiffness": 3.0, "damping": 0.1},
             (2, 3)),
    "sliding stop": ({"use": "stop", "motion": "slide", "upper": 0.3, "stiffness": 3.0}, (2, 3)),
    "friction": ({"use": "joint_friction", "force": 2.0, "critical_rate": 2.0}, (2, 3)),
    "sliding friction": ({"use": "joint_friction", "motion": "slide", "force": 2.0,
                          "critical_rate": 2.0}, (2, 3)),
    "bushing": ({"use": "bushing"}, (2, 3)),
    "gear": ({"use": "gear", "teeth": [2, 3]}, (2, 3)),
    "rack": ({"use": "rack", "radius": 0.3}, (2, 3)),
    "universal": ({"use": "universal", "axis": [1.0, 0.0, 0.0],
                   "second_axis": [0.0, 1.0, 0.0]}, (3,))}


@pytest.mark.full
@pytest.mark.parametrize("flexible", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", LAWS)
def test_laws(name: str, dimension: int, flexible: bool) -> None:
    options, dimensions = LAWS[name]
    if dimension not in dimensions or (flexible and dimension == 3 and name in ("gear", "rack")):
        pytest.skip("does not exist")
    d = dimension
    if d == 3 and name in ("stop", "friction", "gear", "rack"):
        options = {**options, "axis": [0.0, 0.6, 0.8]}
    if name.startswith("sliding"):
        options = {**options, "axis": [0.6, 0.8, 0.0][:d]}
    if name == "rack":
        options = {**options, "direction": [0.6, 0.8, 0.0][:d]}
    if name == "bushing":
        options = {**options, "stiffness": [1.0, 2.0, 3.0][:d], "damping": [0.1, 0.0, 0.3][:d],
                   "turning_stiffness": [4.0] if d == 2 else [4.0, 5.0, 6.0],
                   "axis": [0.6, 0.8, 0.0][:d],
                   **({} if d == 2 else {"second_axis": [-0.8, 0.6, 0.0]})}
    rigid: dict[str, Any] = PLANE if d == 2 else SPACE
    soft = {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
            "material": {"rho": 1.0, "E": 10.0, "nu": 0.3}, "mesh": (
                {"use": "rectangle", "size": [0.4, 0.2], "divisions": [2, 1]} if d == 2 else
                {"use": "block", "size": [0.4, 0.2, 0.2], "divisions": [2, 1, 1]}),
            **({"thickness": 0.1} if d == 2 else {})}
    other = {**rigid, "pose": {"position": [0.4, 0.1, 0.1][:d]}}
    bodies = {"a": soft if flexible else {**rigid}, "b": other}
    between = ["a:right" if flexible else "a:p", "b:p"]
    if name in ("universal",):
        other = {**rigid, "pose": {}}
        bodies["b"] = other if not flexible else {**rigid, "pose": {"position": [0.4, 0.1, 0.1]}}
    made = scene_of({"format": 1, "bodies": bodies, "joints": {
        "joint": {**options, "between": between}}, "time": {"end": 0.1, "step": 0.1}})
    check_joint(made.joints["joint"], made.bodies)


@pytest.mark.parametrize(("joint", "message"), [
    ({"use": "stop", "stiffness": 1.0}, "it limits nothing: give lower, upper or both"),
    ({"use": "stop", "stiffness": 1.0, "upper": -1.0}, "upper"),
    ({"use": "joint_friction"}, "it does nothing: give a force, or a joint with a coefficient"),
    ({"use": "joint_friction", "joint": "pin"}, "joint and coefficient belong together"),
    ({"use": "joint_friction", "joint": "pin", "coefficient": 0.1}, "needs the radius"),
    ({"use": "joint_friction", "joint": "pn", "coefficient": 0.1, "radius": 0.1},
     "joint 'pn' has no multipliers"),
    ({"use": "stop", "stiffness": 1.0, "upper": 1.0, "motion": "slide"}, "axis: missing"),
    ({"use": "bushing", "stiffness": [0.0, 0.0]}, "it does nothing"),
    ({"use": "bushing", "stiffness": [1.0]}, "give 2 numbers"),
    ({"use": "gear", "teeth": [1, 0]}, "1 or more"),
    ({"use": "gear", "teeth": [1, 2]}, "the ground is none"),
])
def test_bad_input_is_refused(joint: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as caught:
        simulate(load(scene({"b": turned(2)}, {
            "pin": {"use": "revolute", "between": ["ground", "b:p"]},
            "odd": {"between": ["b:p", "ground"], **joint}}, 0.1, 0.1)))
    assert message in str(caught.value) and "joints.odd" in str(caught.value)
