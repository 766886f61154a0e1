"""Bodies in space that follow a given motion, and what joints hand from one stage to the other."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor import load, simulate
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core import Joint
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.prescribed_quantities import Followed
from sparsemor.core.protocols.poses import points_in_space, vectors_in_space
from sparsemor.core.protocols.prescribed_motion import FrameHistory, Stage
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.validation import checked_model
from sparsemor.core.testing.in_memory_run import March, march, scene_of

pytestmark = pytest.mark.full

SCENES = Path(__file__).parents[2] / "scenes"
SHORT: dict[str, Any] = {"time.end": 7.5e-5, "training.end": 7.5e-5, "reducer": "full"}
BAR: dict[str, Any] = {
    "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
    "mesh": BlockMesh(size=(0.3, 0.1, 0.06), divisions=(2, 1, 1)),
    "material": {"E": 5e8, "nu": 0.3, "rho": 1100, "alpha": 1e-4, "k": 20, "c": 500}}
PIECE = {"use": "rigid", "mass": 0.4, "inertia": [1e-3, 2e-3, 2.5e-3], "center": [0.1, 0.02, 0.03]}


def hinged() -> dict[str, Any]:
    """Two flexible bars on a hinge (a frame without mass between them), driven, with a rigid body
    welded on; a flexible disk on an axle; a beam that stands still and guides a rigid body."""
    return {
        "bodies": {
            "bar": {**BAR, "fields": ["elastic", "thermal"], "initial_temperature": "293.15+50*x"},
            "mate": {**BAR, "pose": {"position": [0.3, 0.0, 0.0]}},
            "arm": {**PIECE, "points": {"a": [0.0, 0.0, 0.0]},
                    "pose": {"position": [0.6, 0.05, 0.03]}},
            "disk": {**BAR, "frame": "spinning", "pose": {"spin": [0.0, 0.0, 20.0]}},
            "held": {**BAR, "frame": "fixed"},
            "four": {**PIECE, "points": {"a": [0.0, 0.0, 0.0]},
                     "pose": {"position": [0.5, 0.05, 0.03], "spin": [3.0, 0.0, 0.0]}}},
        "joints": {
            "drive": {"use": "prescribed_motion", "of": "bar:left", "axis": [0, 1, 0],
                      "angle": {"use": "ramp", "end": 1.0, "final": 3.0}},
            "root": {"use": "revolute", "between": ["ground", "bar:left"], "axis": [0, 1, 0]},
            "hinge": {"use": "revolute", "between": ["bar:right", "mate:left"], "axis": [0, 1, 0]},
            "weld": {"use": "fixed", "between": ["arm:a", "mate:right"]},
            "axle": {"use": "revolute", "between": ["disk:left", "ground"], "axis": [0, 0, 1]},
            "tube": {"use": "cylindrical", "between": ["four:a", "held:right"],
                     "axis": [1, 0, 0]}},
        "loads": {"weight": {"use": "gravity", "g": [1.0, 2.0, -9.0]},
                  "gust": {"use": "traction", "on": ["mate:top"], "traction": [30, 10, 5]}},
        "time": {"end": 0.008, "step": 1e-3}}


def stage_of(run: March) -> Stage:
    """Frames and joint forces of a run whose bodies may be flexible."""
    layout, t = run.model.layout, run.t
    frames = {b.owner: FrameHistory(t, *(m[:, layout[b.name]] for m in (run.x, run.v, run.a)))
              for b in layout if b.field == "rigid"}
    multipliers = {b.owner: run.x[:, layout[b.name]] for b in layout if b.field == "multiplier"}
    poses = {n: h.pose for n, h in frames.items()}
    joints: dict[str, Any] = dict(run.model.parts)
    passed_on = {n: joints[n].reactions_passed_on(t, m, poses) for n, m in multipliers.items()
                 if isinstance(joints.get(n), Joint)}
    return Stage(t, frames, frozenset(frames), multipliers, {}, passed_on)


def given_of(free: March, scene: Scene) -> March:
    return march(scene, model=assemble(scene, Followed(stage_of(free))))


@pytest.mark.parametrize(("which", "integrator"), [
    ("hinged", "bdf1"), ("hinged", "generalized_alpha"),
    ("everything_in_space", "generalized_alpha")])
def test_a_run_that_follows_its_own_motion_is_the_same_run(which, integrator):
    reducer = "full"
    if which == "hinged":
        scene = scene_of({**hinged(), "integrator": integrator, "reducer": reducer})
    else:
        scene = load(SCENES / f"{which}.yaml", {"integrator": integrator, "reducer": reducer})
    free = march(scene)
    given = given_of(free, scene)
    assert {b.field for b in given.model.layout} == {"elastic", "thermal"}
    for b in given.model.layout:
        x, y = free.block(b.name), given.block(b.name)
        assert np.abs(x - x[0]).max() > 0
        assert np.abs(x - y).max() < 1e-9 * np.abs(x - x[0]).max(), b.name


def chain() -> dict[str, Any]:
    """Rigid bodies and every joint that space has, each side of which is a body."""
    piece = {**PIECE, "points": {"a": [0.0, 0.0, 0.0], "b": [0.2, 0.05, 0.0]}}
    names, x = ["one", "two", "three", "four", "five", "six"], 0.0
    bodies: dict[str, Any] = {}
    for i, name in enumerate(names):
        bodies[name] = {**piece, "pose": {"position": [x, 0.05 * i, 0.0]}}
        x += 0.2
    bodies["one"]["pose"]["spin"] = [0.0, 0.0, 0.0]
    kinds: list[dict[str, Any]] = [
        {"use": "revolute", "axis": [1, 2, 0]}, {"use": "spherical"},
        {"use": "prismatic", "axis": [0, 1, 1]}, {"use": "cylindrical", "axis": [1, 0, 1]},
        {"use": "fixed"}]
    joints = {f"j{i}": {**kind, "between": [f"{a}:b", f"{b}:a"]}
              for i, (kind, a, b) in enumerate(zip(kinds, names, names[1:], strict=False))}
    return {
        "bodies": bodies, "loads": {"weight": {"use": "gravity", "g": [1.0, 2.0, -9.0]}},
        "joints": {**joints, "drive": {
            "use": "prescribed_motion", "of": "one:a", "axis": [0, 0, 1], "z": 0.0,
            "angle": {"use": "ramp", "end": 1.0, "final": 2.0}}},
        "time": {"end": 0.3, "step": 5e-3}, "integrator": {"use": "generalized_alpha"}}


def test_what_is_handed_on_balances_every_body():
    """Newton and Euler for each body, about its centre of mass, with those forces and moments."""
    run = march(scene_of(chain()))
    layout, joints, late = run.model.layout, dict(run.model.parts), slice(5, None)
    stage = stage_of(run)
    com, J = np.array(PIECE["center"]), np.diag(PIECE["inertia"])
    for name in chain()["bodies"]:
        at = layout[f"{name}.rigid"]
        pose, v, a = run.x[:, at], run.v[:, at], run.a[:, at]
        G = np.stack([rot.to_body(p) for p in pose[:, 3:]])
        w, al = (2.0 * np.einsum("tij,tj->ti", G, q[:, 3:]) for q in (v, a))
        Jw = w @ J
        lever = np.cross(al, com) + np.cross(w, np.cross(w, com))
        force = 0.4 * (a[:, :3] + vectors_in_space(pose, lever) - np.array([1.0, 2.0, -9.0]))
        torque = vectors_in_space(pose, al @ J + np.cross(w, Jw))
        center = points_in_space(pose, np.tile(com, (len(pose), 1)))
        size = np.abs(force[late]).max(), 0.1 * np.abs(force[late]).max()
        for joint, known in stage.reactions_passed_on.items():
            part: Any = joints[joint]
            for i, side in enumerate(part.sides):
                if side.body.name == name:
                    f, m = known[:, 6 * i : 6 * i + 3], known[:, 6 * i + 3 : 6 * i + 6]
                    mean = np.tile(side.point, (len(pose), 1))
                    arm = points_in_space(pose, mean) - center
                    force, torque = force + f, torque + m + np.cross(arm, f)
        assert np.abs(force[late]).max() < 1e-8 * size[0], name
        assert np.abs(torque[late]).max() < 1e-8 * size[1], name


def test_rigid_and_flexible_joints_tell_the_same_of_stiff_bodies(tmp_path):
    """The stage's joints have other conditions than those of flexible bodies; handed through a
    rigid stage, a stiff body's displacements are those of the whole flexible run."""
    tree = hinged()
    for body in tree["bodies"].values():
        if body["use"] == "flexible":
            body["material"] = body["material"] | {"E": 5e11, "alpha": 0.0}
    tree["integrator"] = {"use": "generalized_alpha", "rho_inf": 0.5}
    tree["time"] = {"end": 0.05, "step": 1e-3}
    one = simulate(scene_of(tree), cache=Cache(tmp_path))
    two = simulate(scene_of({**tree, "rigid_stage": {}}), cache=Cache(tmp_path))
    assert {b.field for b in two.layout} == {"elastic", "thermal"}
    for name in ("bar", "mate", "disk", "held"):
        x, y = one.block(f"{name}.elastic")[25:], two.block(f"{name}.elastic")[25:]
        assert np.abs(x - y).max() < 0.02 * np.abs(x).max(), name
    for name in ("arm", "disk"):
        np.testing.assert_allclose(two.stage().frames[name].pose[-1], one.pose(name, -1),
                                   atol=1e-4)


def test_quaternions_between_tabled_times_have_length_one():
    t = np.array([0.0, 1.0])
    pose = np.array([[0.0, 0, 0, 1, 0, 0, 0], [1.0, 0, 0, *rot.about([0, 0, 1], 0.8)]])
    h = FrameHistory(t, pose, 0 * pose, 0 * pose)
    np.testing.assert_array_equal(h.at(1.0)[0], pose[1])
    np.testing.assert_allclose(h.at(0.5)[0], [0.5, 0, 0, *rot.about([0, 0, 1], 0.4)], atol=1e-12)


BRICK: dict[str, Any] = {
    "use": "flexible", "material": {"rho": 1000, "E": 1e9, "nu": 0.3, "k": 45, "c": 480},
    "mesh": {"use": "block", "size": [0.1, 0.1, 0.1], "divisions": [1, 1, 1]},
    "reference": {"clamp": "left"}}
PINNED = {"use": "spherical", "between": ["ground", "brick:right"]}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The cache, scene and run of the plane bodies alone."""
    cache = Cache(tmp_path_factory.mktemp("cache"))
    scene = load(SCENES / "small_slider.yaml", SHORT)
    return cache, scene, simulate(scene, cache=cache)


@pytest.mark.parametrize(("brick", "joints"), [
    ({"fields": []}, {}), ({"fields": ["elastic"]}, {"pin": PINNED}),
    ({"fields": ["elastic"], "frame": "spinning"}, {}),
    ({"fields": ["elastic"], "frame": "fixed"}, {}),
    ({"fields": ["thermal"], "frame": "fixed"}, {}),
    ({"fields": ["elastic"], "frame": "fixed"}, {"pin": PINNED}),
])
def test_bodies_in_space_stand_beside_plane_ones_in_two_stages(brick, joints, alone):
    cache, scene, plane = alone
    tree = scene.source.tree
    mixed = scene.using({"bodies": {**tree["bodies"], "brick": BRICK | brick},
                         "joints": {**tree["joints"], **joints},
                         "loads.weight.bodies": ["slider"]})
    checked_model(mixed)
    run = simulate(mixed, cache=cache)
    for b in plane.layout:
        x, y = run.block(b.name), plane.block(b.name)
        assert np.abs(x - y).max() < 1e-4 * np.abs(y).max(), b.name  # Newton stops elsewhere
