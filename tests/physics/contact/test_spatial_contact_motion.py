"""Contact in space inside the step: what presses, falls, slides, sticks, brakes and deforms."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.built_contact import ContactPart
from sparsemor.bodies.frames import rotation as rot
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed
from sparsemor.core.testing.in_memory_run import March, march, scene_of

RHO, G = 1000.0, 9.81
SIZE = (0.1, 0.06, 0.05)
AREA, MASS = SIZE[0] * SIZE[1], RHO * SIZE[0] * SIZE[1] * SIZE[2]
LOW, HIGH = (-0.05, -0.03, 0.0), (0.05, 0.03, 0.05)


def brick(
    lower: tuple[float, ...], size: tuple[float, ...], divisions: tuple[int, ...], **options: Any
) -> dict[str, Any]:
    mesh = {"use": "block", "lower": lower, "size": size, "divisions": divisions}
    return {"use": "flexible", "mesh": mesh, "material": {"rho": RHO}, "fields": [], **options}


def run(
    pose: Mapping[str, Any], foundation: Mapping[str, float], *, end: float, step: float,
    friction: Mapping[str, float] | None = None, plate: Mapping[str, Any] | None = None,
    surface: str = "bottom", loads: Mapping[str, Any] | None = None, **options: Any,
) -> March:
    """A block, its origin in the middle of its base, on a plate whose top goes through 0."""
    contact: dict[str, Any] = {"use": "polygonal", "between": [f"block:{surface}", "plate:top"],
                               "normal": {"use": "elastic_foundation", **foundation}}
    if friction is not None:
        contact["friction"] = {"use": "coulomb", **friction}
    skin = " or ".join(f"abs({c} - {v}) < 1e-9" for edge in (LOW, HIGH)
                       for c, v in zip("xyz", edge, strict=True))
    base = brick((-2.0, -0.4, -0.2), (4.0, 0.8, 0.2), (5, 2, 1), frame="fixed",
                 pose=dict(plate or {}))
    return march(scene_of({
        "bodies": {"block": brick(LOW, SIZE, (2, 1, 1), pose=dict(pose),
                                  sets={"skin": {"where": skin}}), "plate": base},
        "contacts": {"sole": contact}, "time": {"end": end, "step": step}, "integrator": "bdf1",
        "loads": {"weight": {"use": "gravity", "g": [0.0, 0.0, -G]}} if loads is None else loads,
        **options}))


def history(found: March, body: str = "block", contact: str = "sole") -> Mapping[str, FloatArray]:
    at = found.solver.layout[f"{body}.rigid"]
    motion = FrameHistory(found.t, found.x[:, at], found.v[:, at], found.a[:, at])
    part = found.model.parts[contact]
    assert isinstance(part, ContactPart)
    return part.history({body: motion})


@pytest.mark.full
def test_a_box_that_falls_on_its_corner_tumbles_without_gaining_energy() -> None:
    """Between two touches nothing but Euler's own damping is lost."""
    pose = {"position": [0.0, 0.0, 0.075], "axis": [1, 2, 0.3], "angle": 0.7,
            "velocity": [0.2, 0.1, -1.0]}
    found = run(pose, {"stiffness": 2e7}, end=0.06, step=3e-4, surface="skin",
                friction={"coefficient": 0.3, "critical_velocity": 0.01}, integrator="bdf2")
    at = found.solver.layout["block.rigid"]
    x, v = found.x[:, at], found.v[:, at]
    a, b, c = SIZE
    J = MASS / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    E = []
    for q, dq in zip(x, v, strict=True):
        w = 2 * rot.to_body(q[3:]) @ dq[3:]
        A, arm = rot.rotation(q[3:]), np.array([0.0, 0.0, c / 2])
        speed = dq[:3] + A @ np.cross(w, arm)
        E.append(0.5 * MASS * speed @ speed + 0.5 * w @ (J * w)
                 + MASS * G * (q[2] + (A @ arm)[2]))
    free = history(found)["normal"] == 0.0
    energy = np.array(E)[free]
    assert not free.all() and np.abs(2 * rot.to_body(x[-1, 3:]) @ v[-1, 3:]).max() > 1.0
    assert np.all(np.diff(energy) < 1e-4 * E[0])
    assert energy[-1] < 0.95 * E[0]


@pytest.mark.full
def test_a_point_that_flies_through_the_surface_in_one_step_is_noticed() -> None:
    with pytest.raises(SolveFailed, match="contact sole: a point of block went"):
        run({"position": [0.0, 0.0, 0.3], "velocity": [0.0, 0.0, -500.0]}, {"stiffness": 1.0},
            end=0.01, step=1e-3)


@pytest.mark.full
def test_a_pad_brakes_a_wheel_by_its_friction_at_every_angle() -> None:
    """A square pad on a wheel that spins by an angle: torque = mu F r_m, constant."""
    mu, pressure, K, side, reach = 0.7, 1e6, 1e11, 0.04, 0.1
    pad = brick((reach - side / 2, -side / 2, 0.02), (side, side, 0.02), (1, 1, 1),
                frame="spinning")
    inertia = 0.5 * RHO * np.pi * 0.14**4 * 0.02
    wheel = {"use": "flexible", "fields": [], "frame": "spinning", "material": {"rho": RHO},
             "mesh": {"use": "disk", "thickness": 0.02, "triangles": 300, "rim": 40,
                      "layers": 1},
             "sets": {"axle": {"nearest": [0.0, 0.0, 0.0]}}, "pose": {"spin": [0.0, 0.0, 400.0]}}
    found = march(scene_of({
        "bodies": {"pad": pad, "wheel": wheel},
        "joints": {"axle": {"use": "revolute", "between": ["ground", "wheel:axle"],
                            "axis": [0, 0, 1]},
                   "guide": {"use": "prismatic", "between": ["ground", "pad:top"],
                             "axis": [0, 0, 1]}},
        "loads": {"press": {"use": "pressure", "on": ["pad:top"], "pressure": pressure}},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["pad:bottom", "wheel:top"],
            "normal": {"use": "elastic_foundation", "stiffness": K, "damping": 3e6,
                       "damping_depth": 1e-7},
            "friction": {"use": "coulomb", "coefficient": mu, "critical_velocity": 0.05}}},
        "integrator": "bdf1", "time": {"end": 4e-3, "step": 2e-4}}))
    x, w = np.polynomial.legendre.leggauss(20)
    grid = np.hypot(reach + side / 2 * x[:, None], side / 2 * x[None])
    mean = float(w @ grid @ w) / 4
    spin = found.v[:, found.solver.layout["wheel.rigid"]][:, 3]
    slowed = -np.diff(spin)[-8:] / 2e-4
    whole: Any = found.model.parts["wheel"]
    J = np.trace(whole.inertia.second[:2, :2])
    assert J == pytest.approx(inertia, rel=0.03)
    assert slowed * J == pytest.approx(np.full(8, mu * pressure * side**2 * mean), rel=1e-5)
    pose = found.x[:, found.solver.layout["pad.rigid"]]
    assert pose[-1, 2] == pytest.approx(-pressure / K, rel=1e-5)


def column(floor: float, divisions: tuple[int, ...], **options: Any) -> dict[str, Any]:
    material = {"rho": RHO, "E": 1e9, "nu": 0.0}
    return brick((0.0, 0.0, floor), (0.1, 0.1, 0.1), divisions, **options) | {
        "fields": ["elastic"], "material": material}


@pytest.mark.full
def test_an_elastic_column_on_another_sinks_by_all_three_springs() -> None:
    """Both surfaces deform: p / K + p H / E for each column; without Poisson's ratio exactly."""
    pressure, K, E, side = 1e6, 1e11, 1e9, 0.1
    found = march(scene_of({
        "bodies": {
            "upper": column(0.0, (2, 1, 1), reference={"clamp": "top"}, frame="spinning"),
            "lower": column(-side, (1, 2, 1), reference={"clamp": "bottom"}, frame="fixed")},
        "contacts": {"joint": {
            "use": "polygonal", "between": ["upper:bottom", "lower:top"], "surfaces": "deformed",
            "normal": {"use": "elastic_foundation", "stiffness": K}}},
        "joints": {"upright": {"use": "prismatic", "between": ["ground", "upper:top"],
                               "axis": [0, 0, 1]}},
        "loads": {"press": {"use": "pressure", "on": ["upper:top"], "pressure": pressure}},
        "integrator": "bdf1", "time": {"end": 0.2, "step": 0.01}}))
    sunk = -found.block("upper.rigid")[-1, 2]
    assert sunk == pytest.approx(pressure / K + 2 * pressure * side / E, rel=1e-8)
    u = found.block("lower.elastic")[-1]
    assert u[2::3].min() == pytest.approx(-pressure * side / E, rel=1e-8)  # a patch test


def warm(frame: str) -> Model:
    """A hot block on a cold plate, with conductance and friction."""
    hot = {"fields": ["thermal"], "reference_temperature": 0.0,
           "material": {"rho": 7800.0, "k": 45.0, "c": 480.0}}
    return assemble(scene_of({
        "bodies": {"block": brick(LOW, SIZE, (2, 1, 1), frame=frame) | hot,
                   "plate": brick((-0.1, -0.1, -0.1), (0.2, 0.2, 0.1), (3, 2, 1),
                                  frame="fixed") | hot},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["block:bottom", "plate:top"],
            "friction": {"use": "coulomb", "coefficient": 0.3, "critical_velocity": 0.01},
            "normal": {"use": "elastic_foundation", "stiffness": 1e10},
            "heat": {"conductance": 5e3}}},
        "integrator": "bdf1", "time": {"end": 1.0, "step": 1.0}}))


@pytest.mark.full
def test_layers_in_a_row_carry_the_heat_of_their_resistances() -> None:
    side, conductance, k = 0.05, 2e3, 45.0

    def layer(floor: float, divisions: tuple[int, ...]) -> dict[str, Any]:
        return brick((0.0, 0.0, floor), (side,) * 3, divisions, frame="fixed") | {
            "fields": ["thermal"], "material": {"rho": 7800.0, "k": k, "c": 480.0},
            "reference_temperature": 0.0}

    found = march(scene_of({
        "bodies": {"block": layer(0.0, (2, 1, 2)), "base": layer(-side, (1, 3, 1))},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["block:bottom", "base:top"],
            "normal": {"use": "elastic_foundation", "stiffness": 1e10},
            "heat": {"conductance": conductance}}},
        "joints": {"hot": {"use": "prescribed_temperature", "on": ["block:top"],
                           "temperature": 100.0},
                   "cold": {"use": "prescribed_temperature", "on": ["base:bottom"],
                            "temperature": 0.0}},
        "integrator": "bdf1", "time": {"end": 2e5, "step": 2e4}}))
    flux = 100.0 / (2 * side / k + 1 / conductance)
    warm, cool = found.block("block.thermal")[-1], found.block("base.thermal")[-1]
    assert warm.min() == pytest.approx(100.0 - flux * side / k, rel=1e-7)
    assert cool.max() == pytest.approx(flux * side / k, rel=1e-7)


@pytest.mark.full
def test_surfaces_that_never_meet_are_told_at_the_end(tmp_path: Path) -> None:
    scene = scene_of({
        "bodies": {"block": brick(LOW, SIZE, (1, 1, 1), pose={"position": [0.0, 0.0, 0.05]}),
                   "plate": brick((-0.2, -0.2, -0.1), (0.4, 0.4, 0.1), (2, 2, 1),
                                  frame="fixed")},
        "contacts": {"sole": {"use": "polygonal", "between": ["block:bottom", "plate:top"],
                              "normal": {"use": "elastic_foundation", "stiffness": 1e9}}},
        "time": {"end": 1e-3, "step": 1e-4}})
    result = simulate(scene, out=tmp_path / "apart", cache=Cache(tmp_path))
    (told,) = [n for n in result.summary["notes"] if "never met" in n]
    assert "contact sole" in told and "0.05 m" in told
