"""Rigid double pendulum: published angles, orders of accuracy, energy (scenes.md, 1.2 and V7)."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sparsemor.bodies.fem import integrals
from sparsemor.bodies.mesh.generators.link import Link
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

G, LENGTH, START = 9.81, 1.0, (0.0, np.radians(5.0))


@cache
def link() -> tuple[float, float, float]:
    """Mass (kg), distance of the centre of mass from bore A (m), inertia about it (kg m^2)."""
    mesh = Link().build(Path())
    m = integrals.scalar_mass(mesh, 1000.0 * 0.03)
    mass, moment = float(m.sum()), float((m @ mesh.points[:, 0]).sum())
    polar = float(sum(p @ (m @ p) for p in mesh.points.T))
    return mass, moment / mass, polar - moment**2 / mass


def pendulum(
    integrator: dict[str, Any], h: float, end: float, kind: str = "rigid"
) -> March:
    """Two links hanging from each other, frame origins at bore A."""
    mass, center, inertia = link()
    body = {"use": "rigid", "mass": mass, "inertia": inertia, "center": [center, 0.0],
            "points": {"a": [0.0, 0.0], "b": [LENGTH, 0.0]}}
    scene = scene_of({
        "bodies": {"link1": {**body, "pose": {"angle": START[0]}},
                   "link2": {**body, "pose": {"position": [LENGTH, 0.0], "angle": START[1]}}},
        "joints": {"A": {"use": "revolute", "between": ["ground", "link1:a"]},
                   "B": {"use": "revolute", "between": ["link1:b", "link2:a"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -G]}},
        "time": {"end": end, "step": h}, "integrator": integrator})
    return march(scene)


def accelerations(q: FloatArray, w: FloatArray) -> FloatArray:
    """Lagrange's equations of the two angles, written independently of the package."""
    m, c, inertia = link()
    cross = m * LENGTH * c * np.cos(q[0] - q[1])
    M = np.array([[inertia + m * c**2 + m * LENGTH**2, cross], [cross, inertia + m * c**2]])
    swing = m * LENGTH * c * np.sin(q[0] - q[1])
    f = [-swing * w[1] ** 2 - (m * c + m * LENGTH) * G * np.cos(q[0]),
         swing * w[0] ** 2 - m * c * G * np.cos(q[1])]
    return np.asarray(np.linalg.solve(M, f))


@cache
def reference(end: float) -> tuple[Any, ...]:
    """Angles, their rates and the joint forces at `end` by DOP853 in minimal coordinates."""
    found = solve_ivp(
        lambda t, z: np.concatenate([z[2:], accelerations(z[:2], z[2:])]), (0.0, end),
        [*START, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-13)
    q, w = found.y[:2, -1], found.y[2:, -1]
    return q, w, joint_forces(q, w)


def joint_forces(q: FloatArray, w: FloatArray) -> FloatArray:
    """Multipliers of A, then B: minus the forces that the joints exert on links 1 and 2's hosts.

    Rows are lambda_A on link 1 and (lambda_B on link 1, -lambda_B on link 2), with residual
    mass * acceleration - weight + lambda = 0.
    """
    m, c, _ = link()
    al = accelerations(q, w)
    e, spin = np.exp(1j * q), 1j * al - w**2
    host = LENGTH * e[0] * spin[0]
    on_b = m * (host + c * e[1] * spin[1]) + 1j * m * G
    on_a = -m * c * e[0] * spin[0] - 1j * m * G - on_b
    return np.array([on_a.real, on_a.imag, on_b.real, on_b.imag])


def test_numbers_of_the_link() -> None:
    assert link() == pytest.approx((5.6287, 0.5, 0.610181), rel=1e-5)


@pytest.mark.full
def test_reference_gives_the_published_table() -> None:
    table = {0.5: (-63.2251, -25.9023), 1.0: (-153.4535, -146.1370), 4.0: (-158.1150, -265.7840)}
    for t, row in table.items():
        np.testing.assert_allclose(np.degrees(reference(t)[0]), row, rtol=0, atol=1e-4)


def errors(integrator: dict[str, Any], h: float, end: float) -> FloatArray:
    """Largest errors of angles, rates and multipliers at the end."""
    run, (q, w, lam) = pendulum(integrator, h, end), reference(end)
    layout = run.model.layout
    at = [layout[f"{b}.rigid"].start + 2 for b in ("link1", "link2")]
    got = [run.end.x[at], run.end.v[at], run.end.x[layout.algebraic]]
    return np.array([np.abs(a - b).max() for a, b in zip(got, (q, w, lam), strict=True)])


@pytest.mark.full
@pytest.mark.parametrize("integrator, h, order, seen", [
    ({"use": "bdf1"}, 5e-4, 1, 3), ({"use": "bdf2"}, 2e-3, 2, 3),
    ({"use": "generalized_alpha", "rho_inf": 0.5}, 4e-3, 2, 3),
    ({"use": "generalized_alpha", "rho_inf": 1.0}, 4e-3, 2, 2)])
def test_orders_in_angles_rates_and_multipliers(
    integrator: dict[str, Any], h: float, order: int, seen: int
) -> None:
    """At rho_inf = 1 nothing damps the round-off of the multipliers, so they are left out."""
    coarse, fine = (errors(integrator, step, 0.5) for step in (h, h / 2))
    np.testing.assert_allclose(np.log2(coarse / fine)[:seen], order, atol=0.05 * order)


def energy(run: March) -> FloatArray:
    """Kinetic and potential energy, J."""
    m, c, inertia = link()
    total = np.zeros(len(run.t))
    for b in ("link1", "link2"):
        at = run.model.layout[f"{b}.rigid"]
        x, v = run.x[:, at], run.v[:, at]
        arm = c * np.exp(1j * x[:, 2])
        speed = v[:, 0] + 1j * v[:, 1] + 1j * v[:, 2] * arm
        total += m * abs(speed) ** 2 / 2 + inertia * v[:, 2] ** 2 / 2
        total += m * G * (x[:, 1] + arm.imag)
    return total


@pytest.mark.full
def test_bdf1_loses_energy_and_generalized_alpha_keeps_it() -> None:
    """Constraints hold at every step."""
    swing = 30.0  # J, of the order of what is exchanged
    lossy = energy(pendulum({"use": "bdf1"}, 1e-3, 1.0))
    assert lossy[-1] - lossy[0] < -1e-3 * swing
    drifts = []
    for h in (2e-3, 1e-3):
        run = pendulum({"use": "generalized_alpha", "rho_inf": 1.0}, h, 1.0)
        one, two = (run.block(f"{b}.rigid") for b in ("link1", "link2"))
        elbow = np.exp(1j * one[:, 2]) - (two[:, 0] + 1j * two[:, 1])
        assert max(np.abs(one[:, :2]).max(), np.abs(elbow).max()) < 1e-12
        kept = energy(run)
        drifts.append(np.abs(kept - kept[0]).max())
    assert drifts[1] < 1e-4 * swing
    assert np.log2(drifts[0] / drifts[1]) > 1.8


