"""Two-way thermoelastic coupling: damping of a bending beam against Zener's formula, balance of
energy, reduced models, cooling by sudden tension."""

from typing import Any

import numpy as np
import pytest
from scipy.sparse import block_array, block_diag, csc_array, eye_array
from scipy.sparse.linalg import eigs, eigsh

from sparsemor import load, simulate
from sparsemor.core.errors import InputError
from sparsemor.core.model.assembly import assemble

L, H = 1.0e-3, 5.0e-5
E, NU, RHO, ALPHA, C, T0 = 7.0e10, 0.33, 2700.0, 2.3e-5, 900.0, 300.0
PLANE = {"use": "rectangle", "size": [L, H], "divisions": [20, 4]}
SPACE = {"use": "block", "size": [L, H, 0.5 * H], "divisions": [16, 4, 1]}


def beam(mesh: dict[str, Any], k: float, **more: Any) -> dict[str, Any]:
    """A cantilever whose root may contract across."""
    plane = mesh["use"] == "rectangle"
    body = {"use": "flexible", "mesh": mesh, "fields": ["elastic", "thermal"], "frame": "fixed",
            "order": 2, "coupling": "two_way", "reference_temperature": T0,
            "material": {"rho": RHO, "E": E, "nu": NU, "alpha": ALPHA, "k": k, "c": C},
            "sets": {"foot": {"nearest": [0.0, H / 2, 0.0][:2 if plane else 3]}},
            "reference": {"hold": {"left": "x", "foot": "y", **({} if plane else {"bottom": "z"})}}}
    if plane:
        body["thickness"] = H
    return {"format": 1, "bodies": {"b": body}, "reducer": "full",
            "time": {"end": 1e-4, "step": 1e-6}, **more}


def zener(mesh: dict[str, Any]) -> tuple[float, float]:
    """Relaxation strength Delta, and tau k, of the specific heat at constant stress: c at constant
    strain and T beta : strain of free expansion, in plane stress beta = E alpha / (1 - nu)."""
    free = 2 / (1 - NU) if mesh is PLANE else 3 / (1 - 2 * NU)
    c = C + T0 * E * ALPHA**2 * free / RHO
    return E * ALPHA**2 * T0 / (RHO * c), RHO * c * H**2 / np.pi**2


def loss(mesh: dict[str, Any], ratio: float) -> float:
    """1/Q of the first bending mode, whose frequency times the relaxation time is `ratio`."""
    cold = assemble(load(beam(mesh, 1.0))).separated.moving[0].operators
    assert cold is not None
    K, M = csc_array(cold.stiffness), csc_array(cold.mass)
    omega = float(np.sqrt(eigsh(K, 1, M, sigma=0, v0=np.ones(len(cold.constant)))[0][0]))
    model = assemble(load(beam(mesh, zener(mesh)[1] * omega / ratio)))
    u, heat = model.separated.moving[0].operators, model.separated.heat[0]
    (term,) = model.separated.between  # heat of deformation, on temperatures by rates
    at, zero = model.layout, np.zeros(model.layout.size)
    assert u is not None
    j = term.columns
    B = csc_array((len(model.x0), len(model.x0)))
    J = term.jacobian(zero[j], zero[j], zero[j], 0.0, np.ones(len(j)), zero[j]).tocoo()
    B = csc_array((J.data, (term.rows[J.row], j[J.col])), shape=B.shape)
    G = B[at["b.thermal"]][:, at["b.elastic"]]
    one = eye_array(len(u.constant))
    A = block_array([[None, one, None], [-u.stiffness, None, u.coupling],
                     [None, -G, -heat.conductivity]]).tocsc()
    left = block_diag([one, u.mass, heat.capacity]).tocsc()
    value = eigs(A, 1, left, sigma=1j * omega, v0=np.ones(A.shape[0]))[0][0]
    return float(-2.0 * value.real / abs(value))


@pytest.mark.full
@pytest.mark.parametrize(("mesh", "ratio"), [
    (PLANE, 0.1), (PLANE, 1.0), (PLANE, 3.0), (SPACE, 0.3), (SPACE, 1.0)])
def test_damping_of_a_beam_follows_zener(mesh: dict[str, Any], ratio: float) -> None:
    """1/Q = Delta r / (1 + r^2) with r = omega tau, tau = rho c h^2 / (pi^2 k) (Zener 1937, doi
    10.1103/PhysRev.52.230)."""
    assert loss(mesh, ratio) == pytest.approx(zener(mesh)[0] * ratio / (1 + ratio**2), rel=0.02)


OMEGA = 1.8751041**2 * np.sqrt(E * H**2 / (12 * RHO)) / L**2
"""First bending frequency, rad/s."""


def plucked(mesh: dict[str, Any] = PLANE, **more: Any) -> dict[str, Any]:
    """The beam, most damped, after a smooth push at its tip of half a period."""
    mesh = {**mesh, "divisions": [10, 4, 1][:len(mesh["divisions"])]}
    force = [0.0, 1e-3, 0.0][:len(mesh["divisions"])]
    half = np.pi / OMEGA
    push = [{"use": "smooth_step", "end": half, "final": 1.0},
            {"use": "smooth_step", "start": half, "end": 2 * half, "final": -1.0}]
    scene = {"loads": {"pull": {"use": "point_force", "on": "b:right", "force": force,
                                "factor": {"use": "sum", "terms": push}}},
             "integrator": {"use": "generalized_alpha", "rho_inf": 1.0},
             "time": {"end": 10 * half, "step": half / 25}}
    return beam(mesh, zener(PLANE)[1] * OMEGA, **{**scene, **more})


@pytest.mark.full
def test_energy_is_that_which_conduction_dissipates() -> None:
    """d/dt (v M v / 2 + u K u / 2 + theta C theta / (2 T_ref)) = -theta K_T theta / T_ref: here to
    1e-3 of the loss, by steps of second order, and a share 1/Q of it per radian. The heat content
    of the body changes by that of strain."""
    scene = load(plucked())
    run, model = simulate(scene), assemble(scene)
    m, heat = model.separated.moving[0].operators, model.separated.heat[0]
    assert m is not None and m.coupling is not None
    u, theta = run.block("b.elastic"), run.block("b.thermal") - T0
    h, v = scene.time.step, np.zeros(run.block("b.elastic").shape)
    for n in range(1, len(u)):  # the trapezoidal rule's own rates
        v[n] = 2.0 * (u[n] - u[n - 1]) / h - v[n - 1]

    def form(A: Any, x: np.ndarray) -> np.ndarray:
        return np.einsum("ti,ti->t", x, (A @ x.T).T)

    energy = 0.5 * (form(m.mass, v) + form(m.stiffness, u) + form(heat.capacity, theta) / T0)
    lost = h * form(heat.conductivity, 0.5 * (theta[1:] + theta[:-1])) / T0
    free, lost = energy[52:], np.cumsum(lost[52:])  # the push has ended
    assert free[-1] < 0.98 * free[0]
    assert np.abs(free[0] - free[1:] - lost).max() < 1e-3 * lost[-1]
    rate = np.log(free[0] / free[-1]) / (h * (len(free) - 1) * OMEGA)
    assert rate == pytest.approx(0.5 * zener(PLANE)[0], rel=0.03)
    stored, given = heat.capacity @ theta.T, -T0 * (m.coupling.T @ u.T)
    most = np.abs(given).sum(axis=0).max()
    assert np.abs(stored.sum(axis=0) - given.sum(axis=0)).max() < 1e-3 * most


@pytest.mark.full
@pytest.mark.parametrize(("reducer", "mesh"), [
    *((r, PLANE) for r in ("galerkin", "deim", "lspg", "gnat")),
    *((r, SPACE) for r in ("ecsw", "sparse"))])
def test_reduced_models(reducer: str, mesh: dict[str, Any]) -> None:
    scene = load(plucked(mesh))
    full = simulate(scene)
    run = simulate(scene.using({"reducer": {"use": reducer, "basis": {"use": "pod", "count": 12}}}))
    u = full.nodal_displacement("b", -1)
    assert np.abs(run.nodal_displacement("b", -1) - u).max() < 1e-3 * np.abs(u).max()
    T = full.nodal_temperature("b", -1)
    assert np.ptp(T) > 1e-3
    assert np.abs(run.nodal_temperature("b", -1) - T).max() < 1e-3 * np.ptp(T)


@pytest.mark.parametrize(("change", "message"), [
    ({"fields": ["elastic"]}, "two_way acts between two fields"),
    ({"strains": "nonlinear"}, "that of linear strains"),
    ({"material": {"rho": RHO, "E": {"temperatures": [200, 400], "values": [7e10, 6e10]},
                   "nu": NU, "alpha": ALPHA, "k": 1.0, "c": C}}, "E depends on temperature"),
])
def test_what_has_no_such_heat_is_refused(change: dict[str, Any], message: str) -> None:
    scene = beam(PLANE, 1.0)
    scene["bodies"]["b"] |= change
    with pytest.raises(InputError, match=message):
        simulate(load(scene))
