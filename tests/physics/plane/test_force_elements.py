"""Torques, springs, dampers and motors: closed forms, laws, and every reducer."""

from typing import Any

import numpy as np
import pytest

from joint_runs import BAR, driven, moved, run
from reduced_runs import decoded, learnt
from sparsemor.bodies.joints.rotational_spring import RotationalSpring
from sparsemor.bodies.joints.spring_damper import SpringDamper
from sparsemor.bodies.loads.torque import Torque
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.testing import check_joint, check_load
from sparsemor.core.testing.in_memory_run import March, march, scene_of

EXACT = {"use": "generalized_alpha", "rho_inf": 1.0}
DISK = {"use": "rigid", "mass": 2.0, "inertia": 0.25, "points": {"hub": [0.0, 0.0]}}
BALL = {"use": "rigid", "mass": 2.0, "inertia": [0.1, 0.2, 0.3], "center": [0.1, 0.05, 0.02],
        "points": {"tip": [0.3, 0.1, 0.1]}}
ROD = {"use": "rigid", "mass": 2.0, "inertia": 0.1, "center": [0.1, 0.05],
       "points": {"tip": [0.3, 0.1], "other": [0.1, -0.2]}}
SOLID = {**BAR, "mesh": {"use": "block", "size": [0.5, 0.1, 0.06], "divisions": [2, 1, 1]}}
SOLID.pop("thickness")


# --------------------------------------------------------------------------- closed forms


def test_a_torque_accelerates_a_disk_evenly() -> None:
    got = run({"disk": DISK}, {"pin": {"use": "revolute", "between": ["ground", "disk:hub"]}},
              1.0, 0.02, {"motor": {"use": "torque", "on": "disk:hub", "torque": 3.0}})
    assert got.x[-1, 2] == pytest.approx(0.5 * 3.0 / 0.25, rel=1e-9)


def test_a_mass_on_a_spring_and_damper_follows_the_damped_oscillation() -> None:
    m, k, c, v0 = 2.0, 80.0, 3.0, 0.4
    got = run({"ball": moved(DISK, 0.5, 0.0, velocity=[v0, 0.0])},
              {"spring": {"use": "spring_damper", "between": ["ground", "ball:hub"],
                          "stiffness": k, "damping": c, "length": 0.4}}, 1.0, 2e-3,
              integrator=EXACT)
    d, w = c / (2 * m), np.sqrt(k / m - (c / (2 * m)) ** 2)
    want = 0.4 + np.exp(-d * got.t) * (0.1 * np.cos(w * got.t)
                                       + (v0 + d * 0.1) / w * np.sin(w * got.t))
    assert np.abs(got.x[:, 0] - want).max() < 3e-5
    assert np.abs(got.x[:, 1:3]).max() < 1e-14


def test_an_actuator_force_pulls_two_free_bodies_together() -> None:
    bodies = {"one": moved(DISK, 0.0, 0.0), "two": moved(DISK, 3.0, 4.0)}
    got = run(bodies, {"ram": {"use": "spring_damper", "between": ["one:hub", "two:hub"],
                               "force": 6.0}}, 0.5, 0.01)
    at = got.x[-1]
    assert at[:2] == pytest.approx(0.5 * 3.0 * 0.25 * np.array([0.6, 0.8]), rel=1e-9)
    assert at[3:5] + at[:2] == pytest.approx([3.0, 4.0], rel=1e-12)  # momentum


def test_a_motor_with_a_spring_turns_to_its_angle() -> None:
    """I phi'' + c phi' + k (phi - a) = T between two disks: reduced inertia I / 2."""
    pins = {f"pin_{n}": {"use": "revolute", "between": ["ground", f"{n}:hub"]}
            for n in ("one", "two")}
    got = run({"one": DISK, "two": DISK}, {**pins, "motor": {
        "use": "rotational_spring", "between": ["one:hub", "two:hub"], "stiffness": 40.0,
        "damping": 1.5, "angle": 0.3, "torque": 2.0}}, 1.0, 2e-3, integrator=EXACT)
    inertia, end = 0.125, 0.3 + 2.0 / 40.0
    d, w0 = 1.5 / (2 * inertia), np.sqrt(40.0 / inertia)
    w = np.sqrt(w0**2 - d**2)
    want = end * (1 - np.exp(-d * got.t) * (np.cos(w * got.t) + d / w * np.sin(w * got.t)))
    assert np.abs(got.x[:, 2] - got.x[:, 5] - want).max() < 2e-4
    assert np.abs(got.x[:, 2] + got.x[:, 5]).max() < 1e-12  # of equal and opposite moments


def settled(body: dict[str, Any], joints: dict[str, Any], loads: dict[str, Any]) -> March:
    """A cantilever at rest in space, after long damped steps."""
    return march(scene_of({"bodies": {"bar": {**body, "frame": "fixed"}}, "joints": joints,
                           "loads": loads, "time": {"end": 200.0, "step": 10.0}}))


def test_a_torque_bends_a_cantilever_as_beam_theory_says() -> None:
    mesh = {"use": "rectangle", "lower": [0.0, -0.05], "size": [1.0, 0.1], "divisions": [20, 2]}
    fine = {**BAR, "mesh": mesh, "order": 2, "model": "plane_stress",
            "material": {"E": 5e8, "nu": 0.0, "rho": 1100}}
    M, EI = 20.0, 5e8 * 0.02 * 0.1**3 / 12
    got = settled(fine, {}, {"end": {"use": "torque", "on": "bar:right", "torque": M}})
    shape = got.model.geometry["bar.elastic"]
    tip = (shape[0][:, 0] > 0.999) & (shape[1] == 1)
    assert got.block("bar.elastic")[-1][tip].mean() == pytest.approx(M / (2 * EI), rel=2e-3)


def test_the_multiplier_of_a_flexible_side_is_the_force_of_the_spring() -> None:
    got = settled(BAR, {"spring": {"use": "spring_damper", "between": ["bar:right", "ground"],
                                   "stiffness": 3e3, "length": 0.05, "ground": [0.6, 0.0]}}, {})
    u = got.block("bar.elastic")[-1]
    points, component = got.model.geometry["bar.elastic"]
    at = [0.5 + u[(points[:, 0] > 0.4999) & (component == 0)].mean(),
          u[(points[:, 0] > 0.4999) & (component == 1)].mean()]
    force = 3e3 * (np.hypot(0.6 - at[0], at[1]) - 0.05)
    assert at[0] - 0.5 > 1e-7
    assert np.hypot(*got.block("spring.multiplier")[-1, :2]) == pytest.approx(force, rel=1e-9)


def test_a_torsional_pendulum_in_space_swings_about_its_axis() -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    ball = {**BALL, "inertia": [0.25, 0.25, 0.25], "center": [0.0, 0.0, 0.0],
            "points": {"hub": [0.0, 0.0, 0.0]}, "pose": {"position": [0.0, 0.0, 0.0]}}
    got = run({"ball": ball}, {
        "pin": {"use": "revolute", "between": ["ground", "ball:hub"], "axis": axis.tolist()},
        "spring": {"use": "rotational_spring", "between": ["ground", "ball:hub"],
                   "axis": axis.tolist(), "stiffness": 40.0, "angle": -0.5}}, 0.5, 2e-3,
              integrator=EXACT)
    p = got.x[:, 3:7]
    angle = 2 * np.arctan2(p[:, 1:] @ axis, p[:, 0])
    # the first side is the ground: it turns by -0.5 relative to the ball
    want = 0.5 * (1 - np.cos(np.sqrt(40.0 / 0.25) * got.t))
    assert np.abs(angle - want).max() < 2e-3


def test_a_torque_in_space_turns_a_ball_about_its_axis() -> None:
    ball = {**BALL, "inertia": [0.25, 0.25, 0.25], "center": [0.0, 0.0, 0.0]}
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    for axes in ("space", "body"):
        got = run({"ball": ball}, {}, 1.0, 0.01, {"motor": {
            "use": "torque", "on": "ball:tip", "torque": (0.5 * axis).tolist(), "axes": axes}})
        p = got.x[-1, 3:7]
        assert 2 * np.arctan2(np.linalg.norm(p[1:]), p[0]) == pytest.approx(1.0, rel=1e-4)
        assert p[1:] / np.linalg.norm(p[1:]) == pytest.approx(axis, abs=1e-9)


# --------------------------------------------------------------------------- laws and reducers


@pytest.mark.full
@pytest.mark.parametrize("between", [
    ("a:tip", "b:other"), ("ground", "b:tip"), ("c:right", "a:tip"), ("c:right", "d:right")])
def test_plane_elements_keep_the_laws(between: tuple[str, str]) -> None:
    every = {"a": ROD, "b": moved(ROD, 0.7, 0.4, angle=0.3, spin=1.0), "c": moved(BAR, -1.0, 0.5),
             "d": moved(BAR, 1.0, 1.0)}
    bodies = {n: b for n, b in every.items() if any(s.startswith(f"{n}:") for s in between)}
    check_joint(SpringDamper(between=between, stiffness=500.0, damping=7.0, length=0.3), bodies)
    check_joint(RotationalSpring(between=between, stiffness=50.0, damping=0.7), bodies)


@pytest.mark.full
@pytest.mark.parametrize("between", [
    ("a:tip", "b:tip"), ("ground", "b:tip"), ("c:right", "a:tip"), ("e:right", "c:right")])
def test_spatial_springs_keep_the_laws(between: tuple[str, str]) -> None:
    every = {"a": BALL, "b": {**BALL, "pose": {
        "position": [0.7, 0.4, 0.2], "angle": 0.3, "axis": [1, 1, 0], "spin": [1.0, 0.2, 0.3]}},
        "c": {**SOLID, "pose": {"position": [-1.0, 0.5, 0.0]}}, "e": {**SOLID, "frame": "spinning"}}
    bodies = {n: b for n, b in every.items() if any(s.startswith(f"{n}:") for s in between)}
    check_joint(SpringDamper(between=between, stiffness=500.0, damping=7.0, length=0.3), bodies)
    check_joint(RotationalSpring(between=between, stiffness=50.0, damping=0.7, torque=2.0,
                                 axis=(1.0, 2.0, 2.0)), bodies)


@pytest.mark.full
def test_torques_keep_the_laws() -> None:
    check_load(Torque(on="a:tip", torque=3.0), {"a": ROD})
    check_load(Torque(on="c:right", torque=3.0), {"c": BAR})
    for frame in ("floating", "spinning", "fixed"):
        for axes in ("body", "space"):
            check_load(Torque.model_validate(
                {"on": "c:right", "torque": [1.0, 3.0, 2.0], "axes": axes}),
                {"c": {**SOLID, "frame": frame}})


@pytest.mark.full
def test_every_reducer_follows_the_full_order() -> None:
    full = march(scene_of(driven()))
    basis = {"use": "pod", "count": 12}
    for use, more in (("galerkin", {}), ("deim", {}), ("gnat", {}), ("lspg", {}), ("ecsw", {}),
                      ("sparse", {"budgets": {"*": {"rows": 28, "atoms": 12}}})):
        got = march(scene_of(driven({"use": use, "basis": basis, **more})), snapshots=learnt(full))
        for block in ("one.elastic", "two.elastic", "one.rigid", "base.multiplier"):
            if block not in got.solver.layout:
                continue
            want, found = full.block(block), decoded(got, block)
            error = np.abs(found - want).max() / np.abs(want).max()
            assert error < 1e-3, (use, block, error)


# --------------------------------------------------------------------------- refusals


@pytest.mark.parametrize("joint, message", [
    ({"use": "spring_damper", "between": ["ground", "disk:hub"], "stiffness": 1.0},
     "the two points coincide at the start"),
    ({"use": "spring_damper", "between": ["ground", "disk:hub"]}, "it does nothing"),
    ({"use": "rotational_spring", "between": ["ground", "disk:hub"]}, "it does nothing"),
    ({"use": "spring_damper", "between": ["ground", "disk:hub"], "stiffness": 1.0,
      "ground": [1.0, 0.0, 0.0]}, "give 2 components"),
])
def test_faults_are_named(joint: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        assemble(scene_of({"bodies": {"disk": DISK}, "joints": {"j": joint},
                           "time": {"end": 1.0, "step": 0.1}}))


def test_a_torque_needs_components_of_the_dimension() -> None:
    with pytest.raises(InputError, match="give one number"):
        assemble(scene_of({"bodies": {"disk": DISK}, "time": {"end": 1.0, "step": 0.1}, "loads": {
            "t": {"use": "torque", "on": "disk:hub", "torque": [0.0, 0.0, 1.0]}}}))


def test_a_spring_is_refused_with_a_rigid_stage() -> None:
    scene = scene_of({**driven(), "rigid_stage": {}})
    with pytest.raises(InputError, match="computed in a rigid stage: drop rigid_stage"):
        checked_model(scene)
