"""Flexible bodies in free flight, spinning and under their weight: what mechanics must conserve."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.spatial import Delaunay

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


def flight(h: float, rho: float = 1.0) -> March:
    return march(scene_of({
        "bodies": {"plate": PLATE}, "time": {"end": 0.05, "step": h},
        "integrator": {"use": "generalized_alpha", "rho_inf": rho}}))


@pytest.mark.full
def test_inertia_forces_of_a_free_body_balance_at_every_instant() -> None:
    """To round-off: the equations hold at the step's end, whatever the integrator."""
    run = flight(1e-3)
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
def test_centre_of_mass_flies_straight() -> None:
    run = flight(5e-4)
    plate = the(run, "plate")
    assert plate.mass_matrix is not None
    path = np.array([(plate.mass_matrix @ nodal(run, plate, i)[0]).sum() for i in (0, 50, 100)])
    speed = moments(plate, *nodal(run, plate, 0)[:2])[:2] @ [1, 1j]
    np.testing.assert_allclose(path[1:] - path[0], speed * np.array([0.025, 0.05]), rtol=1e-4)


@pytest.mark.parametrize("reference", [{"chord": ["bottom_left", "bottom_right"]},
                                       {"chord": ["top_right", "bottom_left"]},
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


def turned(angle: float) -> March:
    """A soft bar, hinged to the ground and to a rigid body, all turned by an angle."""
    e = np.exp(1j * angle)

    def pair(z: complex) -> list[float]:
        return [float((e * z).real), float((e * z).imag)]

    bar = {**PLATE, "fields": ["elastic", "thermal"], "damping": {"mass": 2.0, "stiffness": 1e-4},
           "material": {**RUBBER, "alpha": 1e-4, "k": 20, "c": 500},
           "reference": {"clamp": "left"},
           "pose": {"position": pair(0j), "angle": angle, "spin": 1.0}}
    tip = {"use": "rigid", "mass": 0.4, "inertia": 1e-3, "center": [0.1, 0.02],
           "points": {"a": [0, 0], "b": [0.2, 0.0]},
           "pose": {"position": pair(0.4 + 0j), "angle": angle + 0.5, "velocity": pair(0.4j),
                    "spin": -1.0}}
    return march(scene_of({
        "bodies": {"bar": bar, "tip": tip},
        "joints": {"A": {"use": "revolute", "between": ["ground", "bar:left"]},
                   "B": {"use": "revolute", "between": ["bar:right", "tip:a"]}},
        "loads": {
            "gravity": {"use": "gravity", "g": pair(-9.81j)},
            "wind": {"use": "traction", "on": ["bar:top"], "traction": pair(300 + 100j),
                     "axes": "space"},
            "push": {"use": "pressure", "on": ["bar:bottom"], "pressure": 400.0},
            "pull": {"use": "point_force", "on": "tip:b", "force": pair(1 - 2j)},
            "heat": {"use": "heat_flux", "on": ["bar:top"], "flux": 1e5}},
        "time": {"end": 0.05, "step": 1e-3},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8}}))


@pytest.mark.full
def test_a_turned_scene_gives_turned_results() -> None:
    plain, other = turned(0.0), turned(2.2)
    e = np.exp(2.2j)
    for name in ("bar.elastic", "bar.thermal"):
        size = np.abs(plain.block(name)).max()
        np.testing.assert_allclose(plain.block(name), other.block(name), rtol=0, atol=1e-9 * size)
    for name in ("bar.rigid", "tip.rigid"):
        one, two = plain.block(name), other.block(name)
        np.testing.assert_allclose(two[:, 2], one[:, 2] + 2.2, rtol=0, atol=1e-10)
        np.testing.assert_allclose(two[:, 0] + 1j * two[:, 1], e * (one[:, 0] + 1j * one[:, 1]),
                                   rtol=0, atol=1e-10)
    for name in ("A.multiplier", "B.multiplier"):
        one, two = plain.block(name) @ [1, 1j], other.block(name) @ [1, 1j]
        np.testing.assert_allclose(two, e * one, rtol=0, atol=1e-8 * np.abs(one).max())


def test_a_spinning_disk_widens_as_the_closed_form_says(tmp_path: Path) -> None:
    """u(R) = (1 - nu) rho w^2 R^3 / (4 E) in plane stress (V6), in a free floating frame."""
    radius, speed, E, nu, rho = 0.14, 66.667, 200e9, 0.3, 7850.0
    rings = [np.zeros((1, 2))]
    for i in range(1, 15):
        a = 2 * np.pi * np.arange(6 * i) / (6 * i)
        rings.append(i / 14 * radius * np.stack([np.cos(a), np.sin(a)], axis=1))
    points = np.concatenate(rings)
    cells = Delaunay(points).simplices
    thin = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 1e-9
    meshio.write(tmp_path / "disk.vtk", meshio.Mesh(
        np.pad(points, ((0, 0), (0, 1))), [("triangle", cells[~thin])]))
    run = march(scene_of({
        "bodies": {"disk": {
            "use": "flexible", "mesh": {"use": "file", "path": str(tmp_path / "disk.vtk")},
            "sets": {"hub": {"nearest": [0.0, 0.0]}, "rim": {"nearest": [radius, 0.0]}},
            "thickness": 0.013, "material": {"E": E, "nu": nu, "rho": rho}, "fields": ["elastic"],
            "reference": {"chord": ["hub", "rim"]}, "pose": {"spin": speed}}},
        "time": {"end": 0.02, "step": 1e-3}, "integrator": "bdf1"}))
    disk = the(run, "disk")
    place = nodal(run, disk, -1)[0]
    r = np.linalg.norm(disk.X, axis=1)
    edge, middle = np.abs(r - radius) < 1e-9, place[np.argmin(r)]
    wide = np.abs(place[edge] - middle).mean() - radius
    assert wide == pytest.approx((1 - nu) * rho * speed**2 * radius**3 / (4 * E), rel=0.01)
    assert run.v[-1, 2] == pytest.approx(speed, rel=1e-5)
