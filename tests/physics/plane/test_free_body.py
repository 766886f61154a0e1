"""Flexible bodies in free flight, spinning and under their weight: what mechanics must conserve."""

from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

RUBBER = {"E": 5e6, "nu": 0.3, "rho": 1100}
PLATE = {
    "use": "flexible", "thickness": 0.02, "material": RUBBER, "fields": ["elastic"],
    "mesh": {"use": "rectangle", "lower": [-0.1, -0.05], "size": [0.5, 0.1], "divisions": [10, 2]},
    "reference": {"chord": ["bottom_left", "bottom_right"]},
    "pose": {"position": [0.3, -0.2], "angle": 0.4, "velocity": [1.0, 2.0], "spin": 8.0},
}


def nodal(run: March, body: FloatingBody, at: int) -> tuple[Any, Any, Any]:
    """Complex positions, velocities and accelerations (N,) of the nodes in space axes."""
    fields = []
    for values in (run.x, run.v, run.a):
        u = np.zeros(2 * len(body.X))
        if body.elasticity is not None:
            u[body.elasticity.free] = values[at, run.model.layout[f"{body.name}.elastic"]]
        fields.append((values[at, run.model.layout[f"{body.name}.rigid"]], u.view(complex)))
    (y, u0), (dy, u1), (ddy, u2) = fields
    e, z, w, al = np.exp(1j * y[2]), body.X @ [1, 1j] + u0, dy[2], ddy[2]
    return (y[0] + 1j * y[1] + e * z, dy[0] + 1j * dy[1] + e * (1j * w * z + u1),
            ddy[0] + 1j * ddy[1] + e * ((1j * al - w**2) * z + 2j * w * u1 + u2))


def moments(body: FloatingBody, place: Any, vector: Any) -> FloatArray:
    """sum m vector, x and y, and sum place x m vector."""
    assert body.mass_matrix is not None
    p = body.mass_matrix @ vector
    return np.array([p.sum().real, p.sum().imag, np.vdot(place, p).imag])


def center(body: FloatingBody) -> complex:
    """Centre of mass, m (body axes)."""
    assert body.inertia is not None
    return complex(*body.inertia.moment) / body.inertia.mass


def the(run: March, name: str) -> FloatingBody:
    body = run.model.parts[name]
    assert isinstance(body, FloatingBody)
    return body


def flight(h: float, order: int = 1) -> March:
    return march(scene_of({
        "bodies": {"plate": {**PLATE, "order": order}}, "time": {"end": 0.05, "step": h},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0}}))


@pytest.mark.full
@pytest.mark.parametrize("order", [1, 2])
def test_inertia_forces_of_a_free_body_balance_at_every_instant(order: int) -> None:
    """To round-off: the equations hold at the step's end, whatever the integrator."""
    run = flight(1e-3, order)
    plate = the(run, "plate")
    assert np.abs(run.block("plate.elastic")).max() > 2e-4  # it does deform
    assert plate.inertia is not None
    size = plate.inertia.mass * 8.0**2 * 0.25  # N, mass times the centripetal acceleration
    for at in (0, 1, 10, 50):
        place, _, acceleration = nodal(run, plate, at)
        assert np.abs(moments(plate, place, acceleration)).max() < 1e-9 * size
    assert np.abs(plate.mass_matrix @ acceleration).sum() > 0.1 * size


@pytest.mark.full
def test_momentum_is_kept_to_second_order() -> None:
    drifts = []
    for h in (1e-3, 5e-4):
        run = flight(h)
        plate = the(run, "plate")
        kept = np.array([moments(plate, *nodal(run, plate, i)[:2]) for i in range(len(run.t))])
        drifts.append(np.abs(kept - kept[0]).max(axis=0) / np.abs(kept[0]).max())
    assert np.max(drifts[1]) < 1e-4
    assert np.log2(np.max(drifts[0]) / np.max(drifts[1])) > 1.8


@pytest.mark.full
@pytest.mark.parametrize("reference", [{"chord": ["top_right", "bottom_left"]},
                                       {"clamp": "left"}])
def test_reaction_carries_the_weight_of_the_bent_shape(reference: dict[str, Any]) -> None:
    """At rest, welded at its left end: the moment balance holds with the deformed centre of mass,
    whatever the reference conditions."""
    body = {**PLATE, "reference": reference, "pose": {"angle": 0.3},
            "material": {**RUBBER, "E": 1e8, "alpha": 1e-3},
            "initial_temperature": "293.15 + 2000*y"}
    run = march(scene_of({
        "bodies": {"plate": body}, "loads": {"gravity": {"use": "gravity", "g": [1.5, -9.81]}},
        "joints": {"weld": {"use": "fixed", "between": ["ground", "plate:left"]}},
        "time": {"end": 500.0, "step": 50.0}, "integrator": "bdf1"}))
    plate = the(run, "plate")
    assert np.abs(run.v[-1]).max() < 1e-12  # at rest
    place = nodal(run, plate, -1)[0]
    assert plate.mass_matrix is not None
    mass, g = float(plate.mass_matrix.sum()), 1.5 - 9.81j
    centre = (plate.mass_matrix @ place).sum() / mass
    held = plate.centre_of("left", plate.points["left"]).weights @ place
    undeformed = np.exp(0.3j) * (center(plate) + 0.1)
    force = run.block("weld.multiplier")[-1]
    assert force[0] + 1j * force[1] == pytest.approx(mass * g, rel=1e-9)
    moment = (np.conj(centre - held) * mass * g).imag
    assert force[2] == pytest.approx(moment, rel=1e-8)
    assert abs((np.conj(undeformed) * mass * g).imag - moment) > 0.01 * abs(moment)


