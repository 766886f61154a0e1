"""Torques, springs, dampers and motors: closed forms, laws, and every reducer."""

from typing import Any

import numpy as np
import pytest

from joint_runs import ALPHA, BAR, driven, moved, run
from reduced_runs import decoded, learnt
from sparsemor import simulate
from sparsemor.bodies.joints.springs import RotationalSpring, SpringDamper
from sparsemor.bodies.loads.point_loads import Torque
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing import check_joint, check_load
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.plugins.charts.time_histories import joint_forces_figure
from sparsemor.plugins.study.quantities import QuantityOfInterest

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


@pytest.mark.full
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


@pytest.mark.full
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
                           "loads": loads, "time": {"end": 200.0, "step": 10.0},
                           "integrator": "bdf1"}))


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


@pytest.mark.full
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


@pytest.mark.full
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


# --------------------------------------------------------------------------- recorded forces


@pytest.mark.full
def test_the_force_of_a_spring_between_rigid_sides_is_stored(tmp_path: Any) -> None:
    scene = scene_of({
        "bodies": {"ball": moved(DISK, 0.5, 0.0, velocity=[0.4, 0.0])}, "integrator": EXACT,
        "joints": {"spring": {"use": "spring_damper", "between": ["ground", "ball:hub"],
                              "stiffness": 80.0, "damping": 3.0, "length": 0.4}},
        "time": {"end": 0.5, "step": 2e-3}, "output": {"every": 3}})
    result = simulate(scene, out=tmp_path)
    (name, unit), force = next(iter(result.joint_forces()["spring"].items()))
    assert (name, unit) == ("tension", "N")
    x = march(scene).x[:, 0][np.r_[0:250:3, 250]]
    d, w = 0.75, np.sqrt(40.0 - 0.75**2)
    t = result.times
    rate = np.exp(-d * t) * (0.4 * np.cos(w * t) - (0.1 * 40.0 + 0.4 * d) / w * np.sin(w * t))
    assert np.abs(force - (80.0 * (x - 0.4) + 3.0 * rate)).max() < 2e-3
    assert joint_forces_figure(result) is not None
    largest = QuantityOfInterest(joint="spring").of(result)
    assert largest == np.abs(force).max()


# --------------------------------------------------------------------------- two stages


@pytest.mark.full
def test_an_actuator_stretches_the_bar_that_it_pulls_in_two_stages() -> None:
    """A free bar pulled at its end: F L / (2 E A) under the inertia of its own mass."""
    mesh = {**BAR["mesh"], "divisions": [8, 1]}
    free = {**BAR, "mesh": mesh, "material": {"E": 5e8, "nu": 0.0, "rho": 1100}}
    result = simulate(scene_of({
        "bodies": {"bar": free}, "rigid_stage": {}, "time": {"end": 0.1, "step": 1e-3},
        "joints": {"ram": {"use": "spring_damper", "between": ["bar:right", "ground"],
                           "ground": [1e4, 0.0],
                           "force": {"use": "smooth_step", "end": 0.05, "final": 50.0}}}}))
    assert result.joint_forces()["ram"]["tension", "N"][-1] == pytest.approx(50.0)
    end = result.points("bar")[:, 0] > 0.499
    stretch = result.nodal_displacement("bar", -1)[end, 0].mean()
    assert stretch == pytest.approx(50.0 * 0.5 / (2 * 5e8 * 0.02 * 0.1), rel=2e-3)


def in_space() -> dict[str, Any]:
    """Two flexible bars in space on hinges, with a motor between them and a spring to the
    ground."""
    axis = [0.0, 1.0, 0.0]
    mate = {**SOLID, "pose": {"position": [0.5, 0.0, 0.0]}}
    return {
        "bodies": {"one": SOLID, "two": mate}, "time": {"end": 0.02, "step": 1e-3},
        "joints": {
            "pin": {"use": "revolute", "between": ["ground", "one:left"], "axis": axis},
            "elbow": {"use": "revolute", "between": ["one:right", "two:left"], "axis": axis},
            "motor": {"use": "rotational_spring", "between": ["two:right", "one:right"],
                      "axis": axis, "stiffness": 20.0, "damping": 0.1, "torque": 4.0},
            "tie": {"use": "spring_damper", "between": ["two:right", "ground"],
                    "stiffness": 1e3, "damping": 5.0, "ground": [1.0, 0.3, -0.5]}}}


@pytest.mark.full
@pytest.mark.parametrize(("tree", "E", "integrator"), [
    (driven(), 2e13, ALPHA), (driven(), 2e13, "bdf1"), (driven(), 2e13, "bdf2"),
    (in_space(), 2e12, "bdf1")], ids=["plane, alpha", "plane, bdf1", "plane, bdf2", "space"])
def test_two_stages_of_stiff_bodies_are_the_run_of_one_stage(
    tree: dict[str, Any], E: float, integrator: Any, tmp_path: Any
) -> None:
    """The feedback of the deformation, which two stages neglect, is of the order 1 / E. Driven by
    functions at points of time, not by means over steps, bdf1 was 0.8 % off."""
    bodies = {n: {**b, "material": {**b["material"], "E": E}}
              for n, b in tree["bodies"].items()}
    scene = scene_of({**tree, "bodies": bodies, "integrator": integrator,
                      "time": {"end": 0.01, "step": 1e-3}})
    one = simulate(scene, out=tmp_path / "one")
    two = simulate(scene.using({"rigid_stage": {}}), out=tmp_path / "two")
    for block in ("one.elastic", "two.elastic"):
        x, y = one.block(block), two.block(block)
        assert np.abs(x - y).max() < 2e-3 * np.abs(x).max(), block
    forces = two.joint_forces()
    assert set(forces) == set(one.joint_forces())
    for joint, kept in forces.items():
        wanted = one.joint_forces()[joint]
        scale = max(np.abs(v[1:]).max() for v in wanted.values())
        for name, values in kept.items():
            missed = np.abs(values - wanted[name])[1:]  # the start is undeformed, no equilibrium
            assert missed.max() < 5e-3 * scale, (joint, name)


@pytest.mark.full
def test_a_reduced_run_of_two_stages_has_the_springs_too(tmp_path: Any) -> None:
    scene = scene_of({**driven(), "rigid_stage": {}, "time": {"end": 0.02, "step": 1e-3}})
    reducer = {"use": "galerkin", "basis": {"use": "pod", "count": 15}}
    full = simulate(scene, out=tmp_path / "full")
    reduced = simulate(scene.using({"reducer": reducer}), out=tmp_path / "reduced")
    for block in ("one.elastic", "two.elastic"):
        x, y = full.block(block), reduced.block(block)
        assert np.abs(x - y).max() < 1e-3 * np.abs(x).max()
    np.testing.assert_array_equal(full.joint_forces()["tie"]["tension", "N"],
                                  reduced.joint_forces()["tie"]["tension", "N"])
