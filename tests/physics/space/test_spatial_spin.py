"""Frames that turn about one axis by an angle: the cheap case of a disk on its axle."""

from typing import Any

import numpy as np
import pytest

from sparsemor import compare, simulate
from sparsemor.bodies.frames import rotation as rot
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble
from sparsemor.core.testing.in_memory_run import March, march, scene_of

WHEEL: dict[str, Any] = {
    "use": "rigid", "frame": "spinning", "mass": 10.0, "inertia": [15.0, 15.0, 28.1866],
    "points": {"axle": [0.0, 0.0, 0.0], "rim": [0.0, 0.25, 0.1]},
    "pose": {"spin": [0.0, 0.0, 66.667]}}
AXLE = {"use": "revolute", "between": ["wheel:axle", "ground"], "axis": [0, 0, 1]}
PLATE: dict[str, Any] = {
    "use": "flexible", "frame": "spinning", "fields": ["elastic"],
    "mesh": BlockMesh(lower=(-0.1, -0.1, 0.0), size=(0.25, 0.2, 0.02), divisions=(5, 4, 1)),
    "material": {"E": 2e9, "nu": 0.3, "rho": 7800}, "damping": {"stiffness": 1e-4},
    "sets": {"hub": {"box": [(-0.06, 0.06), (-0.06, 0.06), (0.0, 0.02)]}},
    "reference": {"clamp": "hub"}}


def run(bodies: dict[str, Any], end: float, integrator: Any = "bdf1", **more: Any) -> March:
    return march(scene_of({"bodies": bodies, "time": {"end": end, "step": 1e-3},
                           "integrator": integrator, **more}))


@pytest.mark.full
def test_bdf1_keeps_the_speed_of_a_spinning_frame_and_damps_a_quaternion() -> None:
    """(w h)^2 / 8 of the rate in each step: what an angle about the axis is for."""
    spun = run({"wheel": WHEEL}, 0.1, joints={"axle": AXLE})
    np.testing.assert_allclose(spun.block("wheel.rigid")[:, 3], 66.667 * spun.t, rtol=1e-12)
    assert spun.block("axle.multiplier").shape[1] == 3  # the axle's moments hold by themselves
    free = run({"wheel": {**WHEEL, "frame": "floating"}}, 0.1, joints={"axle": AXLE})
    x, v = free.block("wheel.rigid")[-1], free.v[-1, :7]
    left = 2 * (rot.to_body(x[3:]) @ v[3:])[2] / 66.667
    half = 0.5 * 66.667e-3
    assert left == pytest.approx(1 / np.sqrt(1 + half**2 * 100), rel=1e-3)


@pytest.mark.full
def test_a_braked_wheel_comes_to_the_speed_and_angle_of_the_brake_disk() -> None:
    """1440 N m on 28.1866 kg m^2 from 66.667 rad/s: 5.362 rad/s and 43.217 rad at 1.2 s."""
    pull = {"use": "point_force", "on": "wheel:rim", "force": [1440.0 / 0.25, 0.0, 0.0],
            "axes": "body"}
    got = run({"wheel": WHEEL}, 1.2, joints={"axle": AXLE}, loads={"brake": pull})
    assert got.v[-1, 3] == pytest.approx(5.362, abs=1e-3)
    assert got.x[-1, 3] == pytest.approx(43.217, abs=0.05)
    force = got.block("axle.multiplier")[-1]
    angle = got.x[-1, 3]
    want = 1440.0 / 0.25 * np.array([np.cos(angle), np.sin(angle), 0.0])
    np.testing.assert_allclose(force, want, rtol=0, atol=1e-6 * 5760)


def nodes(got: March, name: str) -> FloatArray:
    """(N, 3) positions at the end."""
    body: Any = got.model.parts[name]
    u = np.zeros(body.X.size)
    u[body.elasticity.free] = got.block(f"{name}.elastic")[-1]
    y = got.block(f"{name}.rigid")[-1]
    A = rot.rotation(y[3:] if len(y) == 7 else rot.about([0, 0, 1], float(y[3])))
    return np.asarray(y[:3] + (body.X + u.reshape(-1, 3)) @ A.T)


@pytest.mark.full
def test_a_spinning_frame_and_a_free_one_on_a_hinge_move_alike() -> None:
    """An unbalanced plate, welded to the wheel: nodes in space agree to the time error."""
    gaps = []
    for h in (1e-3, 5e-4):
        ends = []
        for frame in ("spinning", "floating"):
            spin = {"spin": [0.0, 0.0, 40.0]}
            hub: Any = assemble(scene_of({
                "bodies": {"plate": PLATE}, "time": {"end": 1.0, "step": h}})).parts["plate"]
            middle = hub.X[hub.points["hub"]].mean(axis=0).tolist()
            wheel = {**WHEEL, "frame": frame, "inertia": [0.1, 0.1, 0.05], "pose": spin,
                     "points": {"axle": [0.0, 0.0, 0.0], "flange": middle}}
            got = march(scene_of({
                "bodies": {"wheel": wheel, "plate": {**PLATE, "frame": frame, "pose": spin}},
                "joints": {"axle": AXLE,
                           "weld": {"use": "fixed", "between": ["wheel:flange", "plate:hub"]}},
                "loads": {"g": {"use": "gravity", "g": [0.0, -50.0, -9.81]}},
                "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
                "time": {"end": 0.1, "step": h}}))
            ends.append(nodes(got, "plate"))
            turned = np.ptp(got.block("plate.elastic"), axis=0).max()
            assert turned > 1e-6
        gaps.append(np.abs(ends[0] - ends[1]).max())
    assert gaps[1] < 2e-5
    assert np.log2(gaps[0] / gaps[1]) == pytest.approx(2.0, abs=0.3)


@pytest.mark.full
def test_a_spinning_plate_costs_one_factor_and_one_or_two_iterations() -> None:
    axle = {"use": "revolute", "between": ["plate:hub", "ground"], "axis": [0, 0, 1]}
    round_plate = {**PLATE, "pose": {"spin": [0.0, 0.0, 60.0]}, "mesh": BlockMesh(
        lower=(-0.1, -0.1, 0.0), size=(0.2, 0.2, 0.02), divisions=(4, 4, 2))}
    got = run({"plate": round_plate}, 0.2, joints={"axle": axle})
    assert np.mean(got.iterations[50:]) <= 2.0
    assert got.solver.counters(got.solver.start(got.end)[1])["factorizations"] == 1


@pytest.mark.full
def test_probes_and_positions_of_a_spinning_body() -> None:
    scene = {"bodies": {"plate": {**PLATE, "pose": {"angle": 0.2, "spin": [0.0, 0.0, 10.0]}}},
             "probes": {"tip": {"body": "plate", "at": [0.15, 0.1, 0.02]}},
             "time": {"end": 0.02, "step": 1e-3}}
    kept = simulate(scene_of(scene))
    got = march(scene_of(scene))
    body: Any = got.model.parts["plate"]
    tip = int(np.argmin(np.linalg.norm(body.X - [0.15, 0.1, 0.02], axis=1)))
    np.testing.assert_allclose(kept.probe("tip")[-1, :3], nodes(got, "plate")[tip], atol=1e-12)
    np.testing.assert_allclose(kept.positions("plate", -1), nodes(got, "plate"), atol=1e-12)
    again = simulate(scene_of({**scene, "integrator": {"use": "bdf2"}}))
    assert compare(reference=kept, again=again).errors["again"]["angle_rad"] < 1e-3


@pytest.mark.parametrize(("bodies", "joints", "words"), [
    ({"wheel": {**WHEEL, "pose": {"spin": [1.0, 0.0, 0.0]}}}, {}, "about the z axis alone"),
    ({"wheel": {**WHEEL, "pose": {"axis": [1, 0, 0], "angle": 1.0}}}, {}, "about the z axis alone"),
    ({"wheel": {**WHEEL, "inertia": 1.0, "points": {}, "pose": {}}}, {}, "one axis anyway"),
    ({"wheel": WHEEL}, {"J": {**AXLE, "axis": [1, 0, 1]}}, "must be \\[0, 0, 1\\]"),
    ({"plate": {**PLATE, "pose": {"quaternion": [1, 0, 0, 0]}}}, {}, "about the z axis alone"),
])
def test_wrong_spins_are_told(bodies: Any, joints: Any, words: str) -> None:
    scene = scene_of({"bodies": bodies, "joints": joints, "time": {"end": 1.0, "step": 0.1}})
    with pytest.raises(InputError, match=words):
        assemble(scene)
