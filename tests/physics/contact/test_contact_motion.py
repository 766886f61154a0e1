"""Contact inside the step: what presses, falls, slides and sticks."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.built_contact import ContactPart
from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.status import SolveFailed, Status
from sparsemor.core.testing.in_memory_run import March, march, scene_of

RHO, WIDTH, G = 1000.0, 0.02, 9.81
LENGTH, HEIGHT = 0.1, 0.05
AREA, MASS = LENGTH * WIDTH, RHO * LENGTH * HEIGHT * WIDTH


def block(
    lower: list[float], size: list[float], divisions: list[int], width: float = WIDTH,
    rho: float = RHO, **options: Any,
) -> dict[str, Any]:
    mesh = {"use": "rectangle", "lower": lower, "size": size, "divisions": divisions}
    made = {"use": "flexible", "mesh": mesh, "thickness": width, "material": {"rho": rho},
            "fields": []}
    return made | options


def run(
    pose: Mapping[str, Any], foundation: Mapping[str, float], *, end: float, step: float,
    friction: Mapping[str, float] | None = None, slope: float = 0.0, surface: str = "bottom",
    loads: Mapping[str, Any] | None = None, **options: Any,
) -> March:
    """A block, its origin in the middle of its base, on a plate whose top goes through (0, 0)."""
    contact: dict[str, Any] = {"use": "polygonal", "between": [f"block:{surface}", "plate:top"],
                               "normal": {"use": "elastic_foundation", **foundation}}
    if friction is not None:
        contact["friction"] = {"use": "coulomb", **friction}
    sets = {"around": {"where": "abs(x) > 0.05 - 1e-9 or y < 1e-9 or y > 0.05 - 1e-9"}}
    return march(scene_of({
        "bodies": {
            "block": block([-LENGTH / 2, 0.0], [LENGTH, HEIGHT], [4, 2], pose=pose, sets=sets),
            "plate": block([-2.0, -0.2], [4.0, 0.2], [7, 1], frame="fixed",
                           pose={"angle": slope})},
        "contacts": {"sole": contact}, "time": {"end": end, "step": step}, "integrator": "bdf1",
        "loads": {"weight": {"use": "gravity", "g": [0.0, -G]}} if loads is None else loads,
        **options}))


def history(found: March, body: str = "block", contact: str = "sole") -> Mapping[str, FloatArray]:
    at = found.solver.layout[f"{body}.rigid"]
    motion = FrameHistory(found.t, found.x[:, at], found.v[:, at], found.a[:, at])
    part = found.model.parts[contact]
    assert isinstance(part, ContactPart)
    return part.history({body: motion})


def energy(found: March, stiffness: float) -> FloatArray:
    """Of a block that does not turn: kinetic, of height, and in the foundation, J."""
    y, v = found.x[:, 1], found.v[:, 1]
    return np.asarray(0.5 * MASS * v**2 + MASS * G * y
                      + 0.5 * stiffness * AREA * np.minimum(y, 0.0) ** 2)


@pytest.mark.full
def test_a_pressed_block_sinks_to_pressure_over_stiffness_and_gains_nothing_when_released() -> None:
    pressure, K = 1e5, 1e9
    push = {"use": "pressure", "on": ["block:top"], "pressure": {
        "use": "table", "times": [0.0, 2e-3, 1e-2, 1.0001e-2],
        "values": [0.0, pressure, pressure, 0.0]}}
    found = run({}, {"stiffness": K, "damping": 2e5, "damping_depth": 1e-6}, end=2e-2, step=1e-4,
                loads={"push": push})
    held = found.t <= 1e-2 + 1e-9
    assert found.x[held][-1, 1] == pytest.approx(-pressure / K, rel=1e-6)
    assert history(found)["normal"][held][-1] == pytest.approx(pressure * AREA, rel=1e-6)
    assert history(found)["normal"][-1] == 0.0
    stored = 0.5 * pressure**2 / K * AREA
    kinetic = 0.5 * MASS * found.v[-1, 1] ** 2
    assert 0.0 < kinetic < stored
    assert np.abs(found.x[:, 2]).max() < 1e-12  # it does not turn


@pytest.mark.full
def test_a_dropped_block_keeps_its_energy_to_the_order_of_the_integrator() -> None:
    K = 1e7
    pose = {"position": [0.0, 0.002], "velocity": [0.0, -0.3]}
    lost = []
    for step in (2e-4, 1e-4):
        found = run(pose, {"stiffness": K}, end=0.03, step=step, integrator="bdf2")
        E = energy(found, K)
        assert found.x[:, 1].min() < -5e-4 and found.x[-1, 1] > 1e-3
        assert E.max() <= E[0] * (1 + 1e-12)
        lost.append(1.0 - E[-1] / E[0])
    assert lost[1] < 2e-4 and lost[0] / lost[1] > 4.0


@pytest.mark.full
def test_damping_takes_energy_from_a_dropped_block() -> None:
    K, c = 1e7, 2e4
    pose = {"position": [0.0, 0.0], "velocity": [0.0, -0.3]}
    found = run(pose, {"stiffness": K, "damping": c, "damping_depth": 1e-6}, end=0.01, step=1e-5,
                integrator="bdf2", loads={})
    # speed after over before, of a damped oscillator that lets go where the force vanishes
    omega = np.sqrt(K * AREA / MASS)
    zeta = c * AREA / (2 * MASS * omega)
    root = np.sqrt(1 - zeta**2)
    restitution = np.exp(-zeta / root * np.arctan2(2 * zeta * root, 2 * zeta**2 - 1))
    assert found.v[-1, 1] == pytest.approx(0.3 * restitution, rel=3e-3)  # the blow is a jump


@pytest.mark.full
def test_a_box_that_falls_on_its_corner_tumbles_without_gaining_energy() -> None:
    K = 1e8
    pose = {"position": [0.0, 0.06], "angle": 0.4, "velocity": [0.2, 0.0]}
    found = run(pose, {"stiffness": K}, end=0.13, step=1e-4, surface="around",
                friction={"coefficient": 0.3, "critical_velocity": 0.01}, integrator="bdf2")
    spin, v = found.v[:, 2], found.v[:, 0] + 1j * found.v[:, 1]
    arm = np.exp(1j * found.x[:, 2]) * 1j * HEIGHT / 2
    y = found.x[:, 1] + arm.imag
    moving = np.abs(v + 1j * spin * arm) ** 2
    J = MASS * (LENGTH**2 + HEIGHT**2) / 12
    E = 0.5 * MASS * moving + 0.5 * J * spin**2 + MASS * G * y
    free = history(found)["normal"] == 0.0
    assert not free.all() and np.abs(found.v[-1, 2]) > 0.5
    assert np.all(np.diff(E[free]) < 2e-5 * E[0])
    assert E[free][-1] < 0.95 * E[0]


def incline(friction: Mapping[str, float], end: float) -> FloatArray:
    """Speed down a slope of 0.3 rad over time, (M,) m/s."""
    slope, K = 0.3, 1e7
    start = np.exp(1j * slope) * complex(-1.0, -RHO * G * HEIGHT * np.cos(slope) / K)
    found = run({"position": [start.real, start.imag], "angle": slope},
                {"stiffness": K, "damping": 1e5, "damping_depth": 1e-5}, end=end, step=1e-3,
                slope=slope, friction=friction)
    v = found.v[:, 0] + 1j * found.v[:, 1]
    return np.asarray(-(v * np.exp(-1j * slope)).real)


@pytest.mark.full
def test_a_block_slides_down_a_slope_steeper_than_the_friction_angle() -> None:
    speed = incline({"coefficient": 0.2, "critical_velocity": 1e-3}, 0.2)
    want = G * (np.sin(0.3) - 0.2 * np.cos(0.3))
    assert (speed[-1] - speed[-11]) / 1e-2 == pytest.approx(want, rel=1e-8)


@pytest.mark.full
def test_a_block_creeps_below_the_critical_velocity_on_a_gentler_slope() -> None:
    critical = 1e-3
    speed = incline({"coefficient": 0.5, "critical_velocity": critical}, 0.2)
    q = np.roots([-0.5, 0.0, 1.5, -np.tan(0.3) / 0.5])
    creep = critical * float(q[(q > 0) & (q < 1)][0])
    assert speed[-1] == pytest.approx(creep, rel=1e-6)
    assert abs(speed[-1] - speed[-10]) < 1e-6 * critical


def test_a_step_too_long_for_the_contact_is_said_so() -> None:
    with pytest.raises(SolveFailed) as failure:
        run({"position": [0.0, 0.05], "velocity": [0.0, -200.0]}, {"stiffness": 1e6}, end=0.01,
            step=1e-3)
    told = str(failure.value)
    assert failure.value.status is Status.NOT_CONVERGED
    assert "contact sole" in told and "too long for this contact" in told
    assert "smaller time.step" in told


@pytest.mark.full
def test_an_elastic_column_on_another_sinks_by_all_three_springs() -> None:
    """Both surfaces deform: p / K + p H / E for each column; without Poisson's ratio exactly."""
    pressure, K, E, side = 1e6, 1e11, 1e9, 0.1
    material = {"rho": RHO, "E": E, "nu": 0.0}

    def column(floor: float, divisions: list[int], **options: Any) -> dict[str, Any]:
        return block([0.0, floor], [side, side], divisions, fields=["elastic"], **options
                     ) | {"material": material}

    found = march(scene_of({
        "bodies": {
            "upper": column(0.0, [3, 2], reference={"clamp": "top"}),
            "lower": column(-side, [4, 3], reference={"clamp": "bottom"}, frame="fixed")},
        "contacts": {"joint": {
            "use": "polygonal", "between": ["upper:bottom", "lower:top"], "surfaces": "deformed",
            "normal": {"use": "elastic_foundation", "stiffness": K}}},
        "joints": {"upright": {"use": "prescribed_motion", "of": "upper:top", "x": 0.0,
                               "angle": 0.0}},
        "loads": {"press": {"use": "pressure", "on": ["upper:top"], "pressure": pressure}},
        "time": {"end": 0.2, "step": 0.01}, "integrator": "bdf1"}))
    sunk = -found.block("upper.rigid")[-1, 1]
    assert sunk == pytest.approx(pressure / K + 2 * pressure * side / E, rel=1e-9)
    u = found.block("lower.elastic")[-1]
    assert u[1::2].min() == pytest.approx(-pressure * side / E, rel=1e-9)  # a patch test
