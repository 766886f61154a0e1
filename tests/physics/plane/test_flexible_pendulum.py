"""Undamped, unheated flexible double pendulum: energy and order of generalized-alpha."""

from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

G = 9.81
BAR = {"use": "rectangle", "lower": [-0.1, -0.1], "size": [1.2, 0.2], "divisions": [12, 2]}
BAR_SETS = {"chord_a": {"nearest": [0, 0]}, "chord_b": {"nearest": [1, 0]},
            "bore_a": {"box": [[-0.11, 0.11], [-0.11, 0.11]]},
            "bore_b": {"box": [[0.89, 1.11], [-0.11, 0.11]]}}
SMOOTH = {"use": "sine", "amplitude": 0.5, "offset": 0.5, "frequency": 2.0, "phase": -np.pi / 2}


def pendulum(
    h: float, end: float, rho: float, modulus: float, mesh: dict[str, Any],
    sets: dict[str, Any] | None = None, factor: dict[str, Any] | None = None, every: int = 1,
    integrator: Any = None,
) -> March:
    """factor: of gravity, over time. integrator: another than generalized-alpha with rho."""
    link = {"use": "flexible", "mesh": mesh, "sets": sets or {}, "thickness": 0.03,
            "material": {"E": modulus, "nu": 0.3, "rho": 1000}, "fields": ["elastic"],
            "reference": {"chord": ["chord_a", "chord_b"]}}
    angle = float(np.radians(5.0))
    return march(scene_of({
        "bodies": {"link1": link, "link2": {**link, "pose": {"position": [1, 0], "angle": angle}}},
        "joints": {"A": {"use": "revolute", "between": ["ground", "link1:bore_a"]},
                   "B": {"use": "revolute", "between": ["link1:bore_b", "link2:bore_a"]}},
        "loads": {"gravity": {"use": "gravity", "g": [0.0, -G], "factor": factor}},
        "time": {"end": end, "step": h},
        "integrator": integrator or {"use": "generalized_alpha", "rho_inf": rho}}), every=every)


def energies(run: March) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kinetic, elastic and potential energy (M,), J.

    Kinetic from nodal velocities R' + A (w x z + u') and the constant mass matrix: exact.
    """
    kinetic, elastic, potential = (np.zeros(len(run.t)) for _ in range(3))
    for body in run.model.parts.values():
        if not isinstance(body, FloatingBody) or body.mass_matrix is None:
            continue
        y, dy = run.block(f"{body.name}.rigid"), run.v[:, run.model.layout[f"{body.name}.rigid"]]
        u, du = (displacements(run, body, x) for x in (run.x, run.v))
        z, e = body.X @ [1, 1j] + u, np.exp(1j * y[:, 2:])
        speed = dy[:, :1] + 1j * dy[:, 1:2] + e * (1j * dy[:, 2:] * z + du)
        place = y[:, :1] + 1j * y[:, 1:2] + e * z
        m = body.mass_matrix
        kinetic += np.einsum("tn,tn->t", speed.conj(), (m @ speed.T).T).real / 2
        potential += G * (m @ place.T).T.imag.sum(axis=1)
        if body.elasticity is not None:
            flat = u.view(np.float64)
            elastic += np.einsum("tn,tn->t", flat, (body.elasticity.stiffness @ flat.T).T) / 2
    return kinetic, elastic, potential


def displacements(run: March, body: FloatingBody, values: FloatArray) -> Any:
    """(M, N) complex nodal displacements, or their rates, from the states' rows."""
    found = np.zeros((len(run.t), 2 * len(body.X)))
    if body.elasticity is not None:
        found[:, body.elasticity.free] = values[:, run.model.layout[f"{body.name}.elastic"]]
    return found.view(np.complex128)


def drift(run: March) -> float:
    """Largest change of the total energy as a fraction of the potential energy exchanged."""
    kinetic, elastic, potential = energies(run)
    total = kinetic + elastic + potential
    return float(np.abs(total - total[0]).max() / np.ptp(potential))


@pytest.mark.slow
def test_energy_at_full_size() -> None:
    run = pendulum(1e-4, 1.0, 1.0, 7e10, {"use": "link"}, every=10)
    kinetic, elastic, potential = energies(run)
    assert kinetic.max() > 100.0 and np.ptp(potential) > 100.0
    assert elastic.max() > 1e-4  # vibrates: the energy goes through the elastic field too
    assert drift(run) < 1e-6


@pytest.mark.full
def test_energy_of_a_soft_link_is_kept_to_second_order() -> None:
    coarse, fine = (drift(pendulum(h, 0.25, 1.0, 7e7, BAR, BAR_SETS)) for h in (1e-3, 2.5e-4))
    assert fine < 1e-6
    assert np.log2(coarse / fine) / 2 > 1.8


# bdf2 comes to its order only where it resolves the second vibration
@pytest.mark.full
@pytest.mark.parametrize("integrator,h,end", [(None, 1e-3, 0.25), ("bdf2", 2.5e-4, 0.1)],
                         ids=["generalized_alpha", "bdf2"])
def test_a_soft_link_is_integrated_to_second_order(
    integrator: str | None, h: float, end: float
) -> None:
    """Gravity begins smoothly: a sudden load excites vibrations that no step resolves."""
    runs = [pendulum(step, end, 0.8, 7e7, BAR, BAR_SETS, SMOOTH, integrator=integrator)
            for step in (h, h / 2, h / 4)]
    layout = runs[0].model.layout
    angles = [layout[f"link{i}.rigid"].start + 2 for i in (1, 2)]
    elastic = slice(layout["link1.elastic"].start, layout["link2.elastic"].stop)
    for values in (
        [r.end.x[angles] for r in runs], [r.end.x[elastic] for r in runs],
        [r.end.v[angles] for r in runs], [r.end.x[layout.algebraic] for r in runs],
    ):
        one, two = (np.abs(a - b).max() for a, b in zip(values, values[1:], strict=False))
        assert np.log2(one / two) > 1.8
