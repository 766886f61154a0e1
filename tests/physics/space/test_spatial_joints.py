"""Joints in space: what they hold, what they leave free, and the reactions they report."""

from typing import Any

import numpy as np
import pytest

from joint_runs import run
from sparsemor.bodies.frames import rotation as rot
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing.in_memory_run import March, scene_of

TILT: dict[str, Any] = {"axis": [1.0, -2.0, 0.5], "angle": 1.1}
R = rot.rotation(rot.about(TILT["axis"], TILT["angle"]))
G = np.array([1.0, -9.81, 0.0])
ROD: dict[str, Any] = {
    "use": "rigid", "mass": 2.0, "inertia": [0.03, 0.06, 0.05], "center": [0.3, 0.1, -0.05],
    "points": {"a": [0.0, 0.0, 0.0], "b": [0.6, 0.0, 0.2]}}


def listed(v: FloatArray) -> list[float]:
    return [float(c) for c in v]


# --------------------------------------------------------------------------- the plane in space


def plane(h: float) -> March:
    """Two links in a vertical plane."""
    hinge = 0.6 * np.exp(-0.2j)
    bodies = {
        "one": {"use": "rigid", "mass": 1.3, "inertia": 0.05, "center": [0.3, 0.02],
                "points": {"a": [0, 0], "b": [0.6, 0]}, "pose": {"angle": -0.2}},
        "two": {"use": "rigid", "mass": 1.3, "inertia": 0.04, "center": [0.25, 0.0],
                "points": {"a": [0, 0]},
                "pose": {"angle": 0.4, "position": [hinge.real, hinge.imag]}}}
    return run(bodies, {"A": {"use": "revolute", "between": ["ground", "one:a"]},
                        "B": {"use": "revolute", "between": ["one:b", "two:a"]}},
               0.5, h, {"g": {"use": "gravity", "g": listed(G[:2])}})


def space(h: float) -> March:
    """The same links with width, their plane turned by R; the hinges are offset across it."""
    hinge = 0.6 * np.exp(-0.2j)

    def pose(angle: float, place: list[float]) -> dict[str, Any]:
        p = rot.product(rot.about(TILT["axis"], TILT["angle"]), rot.about([0, 0, 1], angle))
        return {"quaternion": listed(p), "position": listed(R @ place)}

    bodies = {
        "one": {"use": "rigid", "mass": 1.3, "inertia": [0.03, 0.04, 0.05],
                "center": [0.3, 0.02, 0.1], "points": {"a": [0, 0, 0], "b": [0.6, 0, 0.2]},
                "pose": pose(-0.2, [0.0, 0.0, 0.0])},
        "two": {"use": "rigid", "mass": 1.3, "inertia": [0.02, 0.03, 0.04],
                "center": [0.25, 0.0, 0.0], "points": {"a": [0, 0, 0]},
                "pose": pose(0.4, [hinge.real, hinge.imag, 0.2])}}
    axis = {"axis": listed(R[:, 2] * 3.0)}
    return run(bodies, {"A": {"use": "revolute", "between": ["ground", "one:a"], **axis},
                        "B": {"use": "revolute", "between": ["one:b", "two:a"], **axis}},
               0.5, h, {"g": {"use": "gravity", "g": listed(R @ G)}})


@pytest.mark.full
def test_a_plane_problem_in_space_is_the_plane_problem() -> None:
    """A tilted plane of hinged links: the difference is the time error of other coordinates, which
    vanishes with the square of the step."""
    worst = []
    for h in (2e-3, 1e-3):
        flat, deep = plane(h), space(h)
        gap = 0.0
        for name in ("one", "two"):
            angle = flat.block(f"{name}.rigid")[:, 2]
            turned = np.array([R.T @ rot.rotation(x[3:]) for x in deep.block(f"{name}.rigid")])
            want = np.array([rot.rotation(rot.about([0, 0, 1], a)) for a in angle])
            gap = max(gap, float(np.abs(turned - want).max()))
            assert np.abs(turned[:, 2] - [0, 0, 1]).max() < 1e-12  # the axis stays where it is
        worst.append(gap)
    assert worst[1] < 2e-5
    assert np.log2(worst[0] / worst[1]) == pytest.approx(2.0, abs=0.1)
    late = slice(20, None)
    force = deep.block("A.multiplier")[late, :3] @ R
    np.testing.assert_allclose(force[:, :2], flat.block("A.multiplier")[late], rtol=0, atol=5e-3)
    assert np.abs(force[:, 2]).max() < 1e-6


# --------------------------------------------------------------------------- each joint


def test_a_weld_carries_weight_and_moment() -> None:
    got = run({"rod": {**ROD, "pose": TILT}},
              {"W": {"use": "fixed", "between": ["ground", "rod:b"]}}, 0.1, 0.01,
              {"g": {"use": "gravity", "g": [0.0, 0.0, -9.81]}}, "bdf1")
    lever = R @ (np.array(ROD["center"]) - ROD["points"]["b"])
    weight = np.array([0.0, 0.0, -2.0 * 9.81])
    reaction = got.block("W.multiplier")[-1]
    np.testing.assert_allclose(reaction[:3], weight, atol=1e-9)
    np.testing.assert_allclose(reaction[3:], np.cross(lever, weight), atol=1e-9)
    assert np.abs(got.block("rod.rigid") - got.block("rod.rigid")[0]).max() < 1e-14


@pytest.mark.full
def test_two_welded_bodies_are_one() -> None:
    """Of the same mass, centre and tensor of inertia, turning freely."""
    two_turn: dict[str, Any] = {"axis": [0.0, 1.0, 0.3], "angle": 0.8}
    A = rot.rotation(rot.about(two_turn["axis"], two_turn["angle"]))
    spin, place = [1.0, 2.0, -1.5], np.array([0.6, 0.0, 0.2])
    joined = run(
        {"one": {**ROD, "pose": {"spin": spin}},
         "two": {**ROD, "mass": 1.0, "pose": {
             **two_turn, "position": listed(place), "spin": spin,
             "velocity": listed(np.cross(spin, place))}}},
        {"W": {"use": "fixed", "between": ["one:b", "two:a"]}}, 0.3, 1e-3)
    c1, c2 = np.array(ROD["center"]), place + A @ np.array(ROD["center"])
    J = np.diag(ROD["inertia"]).astype(float) + A @ np.diag(ROD["inertia"]) @ A.T
    com = (2.0 * c1 + 1.0 * c2) / 3.0
    for m, c in ((2.0, c1), (1.0, c2)):
        d = c - com
        J = J + m * (d @ d * np.eye(3) - np.outer(d, d))
    whole = run({"both": {"use": "rigid", "mass": 3.0, "inertia": J.tolist(), "center": listed(com),
                          "pose": {"spin": spin}}}, {}, 0.3, 1e-3)
    np.testing.assert_allclose(joined.block("one.rigid"), whole.block("both.rigid"),
                               rtol=0, atol=2e-6)
    one, two = (np.array([rot.rotation(x[3:]) for x in joined.block(f"{n}.rigid")])
                for n in ("one", "two"))
    relative = np.einsum("tji,tjk->tik", one, two)
    assert np.abs(relative - A).max() < 1e-13


@pytest.mark.full
def test_a_hinge_leaves_one_rotation() -> None:
    """A rod on a tilted hinge swings with the moment of inertia about that hinge."""
    axis = np.array([0.2, 1.0, 0.4]) / np.linalg.norm([0.2, 1.0, 0.4])
    spin = listed(3.0 * axis)
    got = run({"rod": {**ROD, "pose": {"spin": spin}}},
              {"H": {"use": "revolute", "between": ["rod:a", "ground"], "axis": listed(axis)}},
              0.5, 1e-3)
    turned = np.array([rot.rotation(x[3:]) for x in got.block("rod.rigid")])
    want = np.array([rot.rotation(rot.about(listed(axis), 3.0 * t)) for t in got.t])
    np.testing.assert_allclose(turned, want, rtol=0, atol=2e-6)
    # the hinge turns the centre of mass and holds the products of inertia
    c = np.array(ROD["center"])
    J = np.diag(ROD["inertia"]) + 2.0 * (c @ c * np.eye(3) - np.outer(c, c))
    w, A = 3.0 * axis, turned[-1]
    force = 2.0 * np.cross(w, np.cross(w, A @ c))
    moment = np.cross(w, A @ J @ A.T @ w)
    reaction = got.block("H.multiplier")[-1]
    np.testing.assert_allclose(reaction[:3], -force, rtol=0, atol=1e-3)
    e1, e2 = rot.across(axis)
    np.testing.assert_allclose(
        reaction[3] * e2 - reaction[4] * e1, -(moment - axis * (axis @ moment)), atol=1e-3)


@pytest.mark.full
def test_a_slider_moves_along_its_axis_as_a_falling_mass() -> None:
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    got = run({"rod": {**ROD, "pose": TILT}},
              {"S": {"use": "prismatic", "between": ["ground", "rod:b"], "axis": listed(axis)}},
              0.5, 1e-2, {"g": {"use": "gravity", "g": [0.0, 0.0, -9.0]}})
    x = got.block("rod.rigid")
    want = x[0, :3] + np.outer(-0.5 * 9.0 * axis[2] * got.t**2, axis)
    np.testing.assert_allclose(x[:, :3], want, rtol=0, atol=1e-10)
    np.testing.assert_allclose(x[:, 3:], np.tile(x[0, 3:], (len(x), 1)), rtol=0, atol=1e-12)


@pytest.mark.full
def test_a_nut_on_a_moving_rod_slides_and_turns() -> None:
    """A cylinder on a free rod: total momentum is kept, the axes stay one line."""
    axis = R @ [0.0, 0.0, 1.0]
    ring: dict[str, Any] = {"use": "rigid", "mass": 0.5, "inertia": [0.01, 0.02, 0.03],
            "points": {"a": [0.0, 0.0, 0.0]}}
    place = 0.2 * axis
    spin = np.array([0.5, -1.0, 2.0])
    got = run({"rod": {**ROD, "pose": {**TILT, "spin": listed(spin)}},
               "ring": {**ring, "pose": {
                   **TILT, "position": listed(place), "spin": listed(spin + 4.0 * axis),
                   "velocity": listed(np.cross(spin, place) + 0.3 * axis)}}},
              {"C": {"use": "cylindrical", "between": ["ring:a", "rod:a"],
                     "axis": listed(axis)}}, 1.0, 1e-3)
    slid, turned = [], []
    momentum = []
    layout = got.model.layout
    for x, v in zip(got.x, got.v, strict=True):
        total, about = np.zeros(3), np.zeros(3)
        for name, mass, J, c in (("rod", 2.0, ROD["inertia"], ROD["center"]),
                                 ("ring", 0.5, ring["inertia"], [0.0, 0.0, 0.0])):
            y, dy = x[layout[f"{name}.rigid"]], v[layout[f"{name}.rigid"]]
            A = rot.rotation(y[3:])
            w = A @ (2 * rot.to_body(y[3:]) @ dy[3:])
            com, speed = y[:3] + A @ c, dy[:3] + np.cross(w, A @ c)
            total += mass * speed
            about += A @ np.diag(J) @ A.T @ w + mass * np.cross(com, speed)
        momentum.append([*total, *about])
        rod, nut = x[layout["rod.rigid"]], x[layout["ring.rigid"]]
        A, B = rot.rotation(rod[3:]), rot.rotation(nut[3:])
        slid.append(A.T @ (nut[:3] - rod[:3]))
        turned.append(A.T @ B)
    path, relative = np.array(slid), np.array(turned)
    assert np.abs(path[:, :2]).max() < 1e-12
    assert np.abs(relative[:, 2] - [0, 0, 1]).max() < 1e-12
    assert np.ptp(path[:, 2]) > 0.2
    assert relative[:, 0, 0].min() < -0.9
    kept = np.array(momentum)
    np.testing.assert_allclose(kept, np.tile(kept[0], (len(kept), 1)), rtol=0, atol=2e-5)


@pytest.mark.full
def test_a_driven_hinge_turns_as_told_any_number_of_times() -> None:
    turn = {"use": "ramp", "end": 10.0, "final": 200.0}  # 20 rad/s
    got = run({"rod": {**ROD, "pose": {"spin": [0.0, 0.0, 20.0]}}},
              {"H": {"use": "revolute", "between": ["ground", "rod:a"], "axis": [0, 0, 1]},
               "M": {"use": "prescribed_motion", "of": "rod:a", "angle": turn, "axis": [0, 0, 1]}},
              0.5, 1e-3)
    x = got.block("rod.rigid")
    np.testing.assert_allclose(np.unwrap(np.arctan2(x[:, 6], x[:, 3])), 10.0 * got.t, rtol=0,
                               atol=1e-11)
    assert np.abs(got.block("M.multiplier")[100:]).max() < 1e-3  # a steady turn needs no moment


@pytest.mark.full
def test_a_driven_point_follows_and_its_force_is_the_inertia_force() -> None:
    move = {"use": "sine", "amplitude": 0.05, "frequency": 2.0}
    w = 4 * np.pi
    got = run({"rod": {**ROD, "pose": {"velocity": [0.0, 0.05 * w, 0.0]}}},
              {"D": {"use": "prescribed_motion", "of": "rod:a", "x": 0.0, "y": move, "z": 0.0},
               "A": {"use": "prescribed_motion", "of": "rod:a", "angle": 0.0, "axis": [1, 0, 0]},
               "B": {"use": "prescribed_motion", "of": "rod:a", "angle": 0.0, "axis": [0, 1, 0]},
               "C": {"use": "prescribed_motion", "of": "rod:a", "angle": 0.0, "axis": [0, 0, 1]}},
              0.15, 1e-3)
    x = got.block("rod.rigid")
    np.testing.assert_allclose(x[1:, 1], 0.05 * np.sin(w * got.t[1:]), rtol=0, atol=1e-12)
    pull = 2.0 * 0.05 * w**2 * np.sin(w * got.t)
    late, bound = slice(50, None), 1e-3 * np.abs(pull).max()
    np.testing.assert_allclose(got.block("D.multiplier")[late, 1], pull[late], atol=bound)
    # moments hold the centre of mass that does not lie on the line of the force
    np.testing.assert_allclose(got.block("A.multiplier")[late, 0], 0.05 * pull[late], atol=bound)
    np.testing.assert_allclose(got.block("C.multiplier")[late, 0], 0.3 * pull[late], atol=bound)


# --------------------------------------------------------------------------- bad input


@pytest.mark.parametrize(("joint", "words"), [
    ({"use": "revolute", "between": ["ground", "rod:a"]}, "axis: missing"),
    ({"use": "revolute", "between": ["ground", "rod:a"], "axis": [0, 0, 0]}, "has a direction"),
    ({"use": "spherical", "between": ["ground", "ground"]}, "both sides are the ground"),
    ({"use": "spherical", "between": ["rod:a", "rod:b"]}, "both sides are on body 'rod'"),
    ({"use": "spherical", "between": ["rod:a", "other:a"]}, "do not meet"),
    ({"use": "spherical", "between": ["rod:a", "flat:a"]}, "is plane"),
    ({"use": "spherical", "between": ["flat:a", "ground"]}, "needs bodies in space"),
    ({"use": "prismatic", "between": ["rod:a", "other:a"], "axis": [0, 0, 1]},
     "does not lie on the line"),
    ({"use": "prescribed_motion", "of": "rod:a"}, "nothing is prescribed"),
    ({"use": "prescribed_motion", "of": "flat:a", "z": 1.0}, "the body is plane"),
    ({"use": "revolute", "between": ["ground", "flat:a"], "axis": [0, 0, 1]},
     "normal of the plane"),
])
def test_wrong_joints_are_told(joint: dict[str, Any], words: str) -> None:
    scene = scene_of({
        "bodies": {"rod": ROD, "other": {**ROD, "pose": {"position": [1.0, 0.0, 0.0]}},
                   "flat": {"use": "rigid", "mass": 1.0, "inertia": 1.0, "points": {"a": [0, 0]}}},
        "joints": {"J": joint}, "time": {"end": 1.0, "step": 0.1}})
    with pytest.raises(InputError, match=words) as found:
        assemble(scene)
    assert all(f.key.startswith("joints.J.") for f in found.value.faults)


@pytest.mark.parametrize(("change", "words"), [
    ({"inertia": [1.0, 1.0, 3.0]}, "no distribution of mass"),
    ({"inertia": [1.0, 1.0, 0.0]}, "must be positive"),
    ({"inertia": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}, "not symmetric"),
    ({"center": [0.1, 0.2]}, "the body is in space: give 3 coordinates"),
    ({"inertia": 0.1}, "the body is plane: give 2 coordinates"),
    ({"pose": {"position": [1.0, 2.0]}}, "this body is in space: give three coordinates"),
    ({"pose": {"spin": 2.0}}, "give a vector"),
    ({"pose": {"quaternion": [0, 0, 0, 0]}}, "not zero"),
    ({"pose": {"quaternion": [1, 0, 0, 0], "angle": 1.0}}, "not both"),
])
def test_wrong_bodies_are_told(change: dict[str, Any], words: str) -> None:
    scene = scene_of({"bodies": {"rod": {**ROD, **change}}, "time": {"end": 1.0, "step": 0.1}})
    with pytest.raises(InputError, match=words):
        assemble(scene)


@pytest.mark.parametrize(("load", "words"), [
    ({"use": "gravity", "g": [0.0, -9.81]}, "give three components"),
    ({"use": "point_force", "on": "rod:a", "force": [1.0, 2.0]}, "give three components"),
])
def test_wrong_loads_are_told(load: dict[str, Any], words: str) -> None:
    scene = scene_of({"bodies": {"rod": ROD}, "loads": {"L": load},
                      "time": {"end": 1.0, "step": 0.1}})
    with pytest.raises(InputError, match=words):
        assemble(scene)
