"""Turning a whole scene in space (poses, axes, gravity) changes no elastic field."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

LENGTH, CENTER = 0.4, np.array([0.0, 0.05, 0.04])
GROUND, AXIS = np.array([0.0, 1.0, 0.2]), np.array([0.3, -0.5, 0.8])
ALPHA = {"use": "generalized_alpha", "rho_inf": 0.8}
TEXTBOOK = {"use": "full", "method": "newton"}
DRIVE = {"use": "sine", "amplitude": 0.3, "frequency": 5.0}


def listed(v: FloatArray) -> list[float]:
    return [float(c) for c in v]


def pose(turn: Rotation, place: FloatArray) -> dict[str, Any]:
    v = turn.as_rotvec()
    angle = float(np.linalg.norm(v))
    axis = listed(v) if angle else [0.0, 0.0, 1.0]
    return {"position": listed(place), "axis": axis, "angle": angle}


def bar(turn: Rotation, place: FloatArray, held: str) -> dict[str, Any]:
    return {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": held},
            "mesh": BlockMesh(size=(LENGTH, 0.1, 0.08), divisions=(2, 1, 1)),
            "material": {"E": 1e6, "nu": 0.3, "rho": 1000}, "pose": pose(turn, place)}


def chain(scene: Rotation, kind: str, held: str, seed: int) -> March:
    """A flexible bar on the ground and a second body on its end, both posed at random; `held`: the
    set that the second one is clamped at, "" for a rigid body. `scene` turns everything."""
    first, second = Rotation.random(2, random_state=seed)
    place = np.array([0.1, 0.2, -0.1])
    end = place + first.apply([LENGTH, *CENTER[1:]])
    bodies: dict[str, Any] = {"one": bar(scene * first, scene.apply(place), "left")}
    if held:
        bodies["two"] = bar(scene * second, scene.apply(end - second.apply(CENTER)), held)
    else:
        bodies["two"] = {
            "use": "rigid", "mass": 1.5, "inertia": [3e-3, 5e-3, 7e-3], "center": [0.1, 0.05, 0.0],
            "points": {"left": [0.0, 0.0, 0.0]}, "pose": pose(scene * second, scene.apply(end))}
    axis = {} if kind in ("fixed", "spherical") else {"axis": listed(scene.apply(AXIS))}
    joints: dict[str, Any] = {
        "A": {"use": "revolute", "between": ["ground", "one:left"],
              "axis": listed(scene.apply(GROUND))},
        "B": {"use": kind, "between": ["one:right", "two:left"], **axis}}
    if kind == "revolute" and not held:  # the deformed end turns as prescribed
        joints["A"] = {"use": "revolute", "between": ["ground", "one:right"], **axis}
        joints["C"] = {"use": "prescribed_motion", "of": "one:right", "angle": DRIVE, **axis}
    return march(scene_of({
        "bodies": bodies, "joints": joints, "time": {"end": 0.015, "step": 5e-3},
        "loads": {"g": {"use": "gravity", "g": listed(scene.apply([0.0, -3.0, -9.81]))}},
        "reducer": TEXTBOOK, "integrator": ALPHA}))


@pytest.mark.full
@pytest.mark.parametrize(("kind", "held", "seed"), [
    ("fixed", "", 1), ("fixed", "right", 3), ("revolute", "right", 5), ("prismatic", "", 6),
    ("cylindrical", "right", 8), ("spherical", "right", 9)])
def test_a_chain_turned_as_a_whole_bends_the_same(kind: str, held: str, seed: int) -> None:
    """held "right" puts a frame without mass between the two deformed sides, welded to one."""
    plain = chain(Rotation.identity(), kind, held, seed)
    turned = chain(Rotation.random(random_state=100 + seed), kind, held, seed)
    for name in ("one.elastic", "two.elastic"):
        if name not in plain.model.layout:
            continue
        u = plain.block(name)
        assert np.abs(u).max() > 2e-5  # a field that second-order terms would show in
        np.testing.assert_allclose(turned.block(name), u, rtol=0, atol=1e-8 * np.abs(u).max())


@pytest.mark.full
def test_a_free_body_that_is_driven_about_one_axis_is_free_about_the_others() -> None:
    """The prescribed angle is about the axis, whichever two directions across it measure it."""
    spin = 3.0 * np.pi * AXIS / np.linalg.norm(AXIS) + [5.0, 3.0, 0.0]  # the drive's, and across

    def spun(scene: Rotation) -> FloatArray:
        drive = {"use": "prescribed_motion", "of": "top:hub", "angle": DRIVE,
                 "axis": listed(scene.apply(AXIS))}
        body = {"use": "rigid", "mass": 1.0, "inertia": [1e-3, 2e-3, 3e-3],
                "points": {"hub": [0.0, 0.0, 0.0]},
                "pose": {**pose(scene, np.zeros(3)), "spin": listed(scene.apply(spin))}}
        got = march(scene_of({
            "bodies": {"top": body}, "joints": {"drive": drive},
            "time": {"end": 0.1, "step": 4e-3}, "reducer": TEXTBOOK, "integrator": ALPHA}))
        return Rotation.from_quat(got.block("top.rigid")[:, [4, 5, 6, 3]]).as_matrix()

    turned = Rotation.random(random_state=5)
    np.testing.assert_allclose(
        spun(turned), turned.as_matrix() @ spun(Rotation.identity()), rtol=0, atol=1e-8)
