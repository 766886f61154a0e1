"""Frequency response against closed forms: an oscillator, a beam, a driven support, heat waves."""

from pathlib import Path

import numpy as np
import pytest

from analysed import RHO, E, beam, fin
from sparsemor import InputError, Scene, load, reduce, solve

M, K, C = 2.0, 5000.0, 12.0
HERTZ = np.array([0.0, 2.0, 7.0, 8.0, 20.0])


def oscillator(**changes: object) -> Scene:
    return load({
        "format": 1, "bodies": {"b": {"use": "rigid", "mass": M, "inertia": 0.1,
                                      "points": {"o": [0.0, 0.0]}}},
        "joints": {"guide": {"use": "prismatic", "between": ["ground", "b:o"], "axis": [1.0, 0.0]},
                   "spring": {"use": "spring_damper", "between": ["ground", "b:o"],
                              "ground": [-1.0, 0.0], "stiffness": K, "damping": C, "length": 1.0}},
        "loads": {"push": {"use": "point_force", "on": "b:o", "force": [3.0, 0.0], "factor": 1.0}},
        "time": {"end": 0.1, "step": 1e-3}, "probes": {"p": {"body": "b", "at": "o"}}}, changes)


def complex_of(found, name):  # type: ignore[no-untyped-def]
    phase = np.radians(found.column(f"{name} phase_deg"))
    return np.array(found.column(name)) * np.exp(1j * phase)


def test_an_oscillator() -> None:
    found = solve(oscillator(), "frequency_response", input="loads.push.factor",
                  frequencies=HERTZ, outputs=["p.x", "b.rigid.x_rate"])
    w = 2.0 * np.pi * HERTZ
    exact = 3.0 / (K - w**2 * M + 1j * w * C)
    np.testing.assert_allclose(complex_of(found, "p.x"), exact, rtol=1e-6)
    np.testing.assert_allclose(complex_of(found, "b.rigid.x_rate"), 1j * w * exact, rtol=1e-6)


def test_a_driven_spring() -> None:
    """The force of a drive of the natural length l is K l on the mass."""
    found = solve(oscillator(), "frequency_response", input="joints.spring.length",
                  frequencies=HERTZ, outputs=["p.x"])
    w = 2.0 * np.pi * HERTZ
    np.testing.assert_allclose(
        complex_of(found, "p.x"), K / (K - w**2 * M + 1j * w * C), rtol=1e-6)


def damped_beam(reducer: object = "full") -> Scene:
    push = {"use": "point_force", "on": "beam:right", "force": [0.0, 1.0], "factor": 1.0}
    return beam(height=0.02, cells=(20, 1), loads={"push": push}, damping={"mass": 20.0},
                reducer=reducer)


@pytest.mark.full
def test_the_tip_of_a_beam_and_its_reduced_and_kept_models(tmp_path: Path) -> None:
    f, source = np.array([3.0, 16.7, 60.0, 150.0]), "loads.push.factor"
    full = solve(damped_beam(), "frequency_response", input=source, frequencies=f,
                 outputs=["tip.u_y"], out=tmp_path / "full")
    assert (tmp_path / "full" / "frequency_response.png").stat().st_size > 1000
    line, L = RHO * 0.02 * 0.02, 1.0
    # series of modes of Euler beams: y(L)^2 = 4 for modes of unit mean square
    w, beta = 2.0 * np.pi * f, np.array([1.875104, 4.694091, 7.854757, 10.995541, 14.137168])
    own = beta**2 * np.sqrt(E * 0.02**2 / 12.0 / RHO)
    exact = (4.0 / (line * L) / (own**2 - w[:, None] ** 2 + 20j * w[:, None])).sum(axis=1)
    np.testing.assert_allclose(complex_of(full, "tip.u_y"), exact, rtol=0.03)
    basis = {"use": "modal", "count": 6, "correction": True}
    scene = damped_beam({"use": "galerkin", "basis": basis})
    reduced = solve(scene, "frequency_response", input=source, frequencies=f, outputs=["tip.u_y"])
    np.testing.assert_allclose(complex_of(reduced, "tip.u_y"), complex_of(full, "tip.u_y"),
                               rtol=1e-4)
    from sparsemor.plugins.analyses.solve import solve_kept

    kept = solve_kept(reduce(scene), "frequency_response", input=source, frequencies=f,
                      outputs=["tip.u_y"])
    np.testing.assert_allclose(complex_of(kept, "tip.u_y"), complex_of(reduced, "tip.u_y"),
                               rtol=1e-7)


def test_a_heat_wave() -> None:
    """A slab insulated at one end, with a harmonic flux q at the other: T = q / (k s) / tanh(s L),
    s = sqrt(i omega rho c / k)."""
    lamp = {"lamp": {"use": "heat_flux", "on": ["fin:right"], "flux": 1000.0}}
    air = {"air": {"use": "convection", "on": ["fin:left"], "film": 1e-6, "temperature": 293.15}}
    f = np.array([1e-3, 1e-2, 1e-1])
    found = solve(fin({**lamp, **air}, {}), "frequency_response", input="loads.lamp.flux",
                  frequencies=f, outputs=["tip.temperature"], about="start")
    s = np.sqrt(2j * np.pi * f * 2700.0 * 900.0 / 200.0)
    np.testing.assert_allclose(complex_of(found, "tip.temperature"),
                               1.0 / (200.0 * s * np.tanh(0.1 * s)), rtol=2e-3)


@pytest.mark.parametrize("options, words", [
    ({"input": "loads.push.force"}, "loads.push.force"), ({"input": "loads.pull.factor"}, "pull"),
    ({"input": None}, "name the function"), ({"frequencies": [2.0, 1.0]}, "increasing"),
    ({"outputs": ["p.q"]}, "no output"), ({"input": "bodies.b.mass"}, "no function of time")])
def test_bad_options_are_refused(options: dict[str, object], words: str) -> None:
    given = {"input": "loads.push.factor", "frequencies": [1.0], **options}
    with pytest.raises(InputError, match=words):
        solve(oscillator(), "frequency_response", **given)


def test_an_undamped_resonance_is_refused() -> None:
    scene = oscillator(**{"joints.spring.damping": 0.0})
    with pytest.raises(Exception, match="the response at|not finite"):
        solve(scene, "frequency_response", input="loads.push.factor",
              frequencies=[np.sqrt(K / M) / (2.0 * np.pi)])
