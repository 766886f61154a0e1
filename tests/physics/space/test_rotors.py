"""Whirling rotors against closed forms: a rigid rotor on bushings, and an overhung disk on a
flexible shaft (Stodola 1910, Green 1948).

Analyses of turning bodies are in body axes: a forward whirl at the rate w in space is |w - Omega|
there, a backward one w + Omega.
"""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sparsemor import InputError, Scene, load, simulate, solve
from sparsemor.core.arrays import FloatArray

MASS, POLAR, ACROSS, STIFF = 20.0, 0.9, 0.6, 4e6
"""kg, kg m2, kg m2, N/m of each bearing."""
BEARINGS = (-0.15, 0.25)
"""Distances from the centre of mass, m."""
SPIN = 600.0


def on_bushings(across: float = STIFF, **options: Any) -> Scene:
    """Rotor with the axis z; across: stiffness of both bearings along y."""
    return load({
        "format": 1, "bodies": {"rotor": {
            "use": "rigid", "mass": MASS, "inertia": [ACROSS, ACROSS, POLAR],
            "points": {"a": [0.0, 0.0, BEARINGS[0]], "b": [0.0, 0.0, BEARINGS[1]]},
            "pose": {"spin": [0.0, 0.0, SPIN], **options}}},
        "joints": {name: {"use": "bushing", "between": [f"rotor:{name}", "ground"],
                          "stiffness": [STIFF, across, STIFF]} for name in "ab"},
        "time": {"end": 0.02, "step": 2e-5},
        "integrator": {"use": "generalized_alpha", "rho_inf": 1.0},
        "probes": {"a": {"body": "rotor", "at": "a"}}})


def equations(across: float = STIFF) -> FloatArray:
    """(8, 8) matrix A of y' = A y for y = (q, q'), q = (x, y, tilt about x, tilt about y)."""
    K = np.zeros((4, 4))
    for z in BEARINGS:
        B = np.array([[1.0, 0.0, 0.0, z], [0.0, 1.0, -z, 0.0]])
        K += B.T @ np.diag([STIFF, across]) @ B
    M, G = np.diag([MASS, MASS, ACROSS, ACROSS]), np.zeros((4, 4))
    G[2, 3], G[3, 2] = POLAR * SPIN, -POLAR * SPIN
    return np.block([[np.zeros((4, 4)), np.eye(4)],
                     [-np.linalg.solve(M, K), -np.linalg.solve(M, G)]])


def whirls(A: FloatArray) -> list[float]:
    """Rates in space, 1/s, negative where x + i y turns against the spin."""
    found = []
    values, shapes = np.linalg.eig(A)
    for value, shape in zip(values, shapes.T, strict=True):
        if value.imag > 0.0:
            forward = (shape[1] / shape[0] / -1j).real > 0.0
            found.append(float(value.imag if forward else -value.imag))
    return found


@pytest.mark.full
def test_a_rigid_rotor_splits_into_forward_and_backward_whirls() -> None:
    rates = np.array(whirls(equations()))
    assert sorted(np.sign(rates)) == [-1.0, -1.0, 1.0, 1.0]
    found = np.array(solve(on_bushings(), "frequencies", count=6, spin=True, about="start")
                     .column("imaginary_per_s"))
    # the other two: it turns freely, and moves along its axis on both bearings
    assert found[0] == pytest.approx(0.0, abs=0.01)
    want = [*np.abs(rates - SPIN), np.sqrt(2.0 * STIFF / MASS)]
    np.testing.assert_allclose(found[1:], np.sort(want), rtol=1e-6)


@pytest.mark.full
@pytest.mark.parametrize("across", [STIFF, 0.4 * STIFF])
def test_a_run_whirls_as_the_closed_form(across: float) -> None:
    """Started by a speed along x, on bearings that may differ in x and y."""
    speed, end = 0.05, 0.02
    run = simulate(on_bushings(across, velocity=[speed, 0.0, 0.0]))
    start = np.zeros(8)
    start[4] = speed
    A = equations(across)
    exact = solve_ivp(lambda _, y: A @ y, (0.0, end), start, t_eval=run.times, rtol=1e-10,
                      atol=1e-16).y
    want = np.stack([exact[0] + BEARINGS[0] * exact[3], exact[1] - BEARINGS[0] * exact[2]], axis=1)
    got = np.asarray(run.probe("a"))[:, :2]
    assert np.abs(want[:, 1]).max() > 0.2 * np.abs(want[:, 0]).max()  # gyroscopic moments
    assert np.abs(got - want).max() < 2e-3 * np.abs(want).max()


@pytest.mark.full
def test_supports_that_differ_have_no_modes_in_body_axes() -> None:
    with pytest.raises(InputError, match="vary as the bodies rotate"):
        solve(on_bushings(0.4 * STIFF), "frequencies", spin=True, about="start")


LENGTH, SIDE, E, NU = 0.5, 0.04, 2.1e11, 0.3
DISK = {"mass": 30.0, "across": 0.26, "polar": 0.5}
FAST = 300.0
"""rad/s, above the critical speed of 182 rad/s at which the disk whirls."""


def overhung(**options: Any) -> Scene:
    """Disk at the end of a square shaft of hardly any mass, which a drive turns."""
    return load({
        "format": 1, "bodies": {
            "shaft": {
                "use": "flexible", "order": 2, "fields": ["elastic"], "frame": "spinning",
                "mesh": {"use": "block", "lower": [-SIDE / 2, -SIDE / 2, 0.0],
                         "size": [SIDE, SIDE, LENGTH], "divisions": [2, 2, 16]},
                "material": {"E": E, "nu": NU, "rho": 7.8},
                "reference": {"clamp": "bottom"}, "pose": {"spin": [0.0, 0.0, FAST]}, **options},
            "disk": {"use": "rigid", "mass": DISK["mass"],
                     "inertia": [DISK["across"], DISK["across"], DISK["polar"]],
                     "points": {"o": [0.0, 0.0, 0.0]},
                     "pose": {"position": [0.0, 0.0, LENGTH], "spin": [0.0, 0.0, FAST]}}},
        "joints": {
            "drive": {"use": "prescribed_motion", "of": "shaft:bottom", "x": 0.0, "y": 0.0,
                      "z": 0.0, "axis": [0, 0, 1],
                      "angle": {"use": "ramp", "end": 10.0, "final": 10.0 * FAST}},
            "key": {"use": "fixed", "between": ["shaft:top", "disk:o"]}},
        "time": {"end": 10.0, "step": 1e-3}})


def stodola_green() -> FloatArray:
    """Whirls in space, 1/s: M r'' - i G r' + K r = 0 of deflection and slope, each x + i y, with
    the shear of a square section (Cowper 1966, doi 10.1115/1.3625046)."""
    bending = E * SIDE**4 / 12.0
    shear = 10.0 * (1 + NU) / (12.0 + 11.0 * NU) * E / (2.0 * (1 + NU)) * SIDE**2
    C = np.array([[LENGTH**3 / 3.0 / bending + LENGTH / shear, LENGTH**2 / 2.0 / bending],
                  [LENGTH**2 / 2.0 / bending, LENGTH / bending]])
    M = np.diag([DISK["mass"], DISK["across"]])
    G = np.diag([0.0, DISK["polar"] * FAST])
    A = np.block([[np.zeros((2, 2)), np.eye(2)],
                  [-np.linalg.solve(M, np.linalg.inv(C)), 1j * np.linalg.solve(M, G)]])
    return np.asarray(np.sort(np.linalg.eigvals(A).imag))


@pytest.mark.full
@pytest.mark.parametrize("about", ["equilibrium", "start"])
def test_an_overhung_disk(about: str) -> None:
    """Beyond the critical speed the equilibrium is a maximum of the potential in body axes."""
    found = np.array(solve(overhung(), "frequencies", count=5, spin=True, about=about, at=0.0)
                     .column("imaginary_per_s"))
    torsion = np.sqrt(0.1406 * SIDE**4 * E / 2.0 / (1 + NU) / LENGTH / DISK["polar"])
    whirling = np.delete(found, np.argmin(np.abs(found - torsion)))
    space = stodola_green()
    assert (space < 0.0).sum() == 2
    # of the rates in space: the clamp of the mesh, and the slope that a mean over the end has
    np.testing.assert_allclose(np.sort(np.abs(space - FAST)), whirling, atol=6e-3 * np.abs(
        space).max())
