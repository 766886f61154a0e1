"""Properties that depend on temperature, and several materials in one body, against closed forms.

Kirchhoff's transformation theta(T) = integral of k dT makes steady conduction linear in theta, and
transient conduction where k / c is constant.
"""

from typing import Any

import numpy as np
import pytest

from sparsemor.core.arrays import FloatArray
from sparsemor.core.testing.in_memory_run import March, march, scene_of

L, RHO = 0.1, 1000.0
GROWING = {"polynomial": [20.0, 0.04], "origin": 300.0, "range": [200.0, 2000.0]}
"""k = 20 W/(m K) at 300 K and 0.04 W/(m K^2) more per kelvin."""


def kirchhoff(T: FloatArray) -> FloatArray:
    """theta = integral of k from 300 K, W/m."""
    return 20.0 * (T - 300.0) + 0.02 * (T - 300.0) ** 2


def slab(
    columns: int, end: float, h: float, *, material: dict[str, Any] | None = None,
    start: float | str = 300.0, integrator: Any = "bdf1", capacity: str = "consistent",
    **parts: Any,
) -> March:
    body = {"use": "flexible", "frame": "fixed", "fields": ["thermal"], "thickness": 0.02,
            "mesh": {"use": "rectangle", "size": [L, 0.1 * L],
                     "divisions": [columns, max(columns // 10, 1)]},
            "material": {"rho": RHO, "k": GROWING, "c": 500.0, **(material or {})},
            "reference_temperature": 300.0, "initial_temperature": start, "capacity": capacity}
    return march(scene_of({"bodies": {"slab": body}, "time": {"end": end, "step": h},
                           "integrator": integrator, **parts}))


def last(run: March) -> tuple[FloatArray, FloatArray]:
    """x and temperatures of the unknown nodes at the end."""
    body: Any = run.model.parts["slab"]
    return body.X[body.heat.free, 0], run.block("slab.thermal")[-1]


def steady(columns: int, hot: float) -> float:
    """Error of theta in steady conduction between two temperatures, of its range."""
    held = {name: {"use": "prescribed_temperature", "on": [f"slab:{name}"], "temperature": T}
            for name, T in (("left", hot), ("right", 300.0))}
    x, T = last(slab(columns, 4e7, 1e7, joints=held))
    top = kirchhoff(np.array(hot))
    return float(np.abs(kirchhoff(T) - top * (1 - x / L)).max() / top)


@pytest.mark.full
def test_steady_conduction_follows_kirchhoff_and_converges_in_second_order() -> None:
    assert steady(10, 320.0) < 1e-6
    coarse, fine = steady(10, 900.0), steady(20, 900.0)
    assert 1e-8 < fine < 1e-4
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.3)


def wave(columns: int, h: float) -> float:
    """Error at 60 s of a wave of theta that decays in an insulated slab where c grows as k."""
    growing = {"polynomial": [500.0, 1.0], "origin": 300.0, "range": [200.0, 2000.0]}
    start = "300 - 500 + sqrt(250000 + 50*(6000 + 3000*cos(31.41592653589793*x)))"
    run = slab(columns, 60.0, h, material={"c": growing}, start=start, integrator="bdf2")
    x, T = last(run)
    decay = np.exp(-20.0 / (RHO * 500.0) * (np.pi / L) ** 2 * 60.0)
    want = 6000.0 + 3000.0 * decay * np.cos(np.pi * x / L)
    return float(np.abs(kirchhoff(T) - want).max() / 3000.0)


@pytest.mark.full
def test_a_decaying_wave_converges_in_second_order() -> None:
    coarse, fine = wave(10, 6.0), wave(20, 3.0)
    assert fine < 2e-3
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.4)


HEATED = {"lamp": {"use": "heat_flux", "on": ["slab:left"], "flux": 2e5}}
STORING = {"k": GROWING, "c": {"polynomial": [500.0, 0.5], "origin": 300.0, "range": [200, 2000]}}


@pytest.mark.full
@pytest.mark.parametrize("reducer", ["full", "galerkin"])
def test_heat_that_enters_is_stored(reducer: str) -> None:
    """Sum of the rows of each step: integral of rho (H(T_n) - H(T_(n-1))) = h q A, to 1e-9."""
    chosen: Any = {"use": reducer}
    if reducer == "galerkin":
        chosen["basis"] = {"use": "modal", "count": 20}
    run = slab(20, 40.0, 2.0, material=STORING, loads=HEATED, reducer=chosen)
    maps, T = run.solver.dictionaries, run.block("slab.thermal")
    if maps:
        T = maps["slab.thermal"].offset + T @ maps["slab.thermal"].atoms.T
    C = run.model.separated.heat[0].capacity
    s = T - 300.0
    content = (C @ s.T).sum(axis=0) + 0.5e-3 * np.einsum("si,si->s", s, (C @ s.T).T)
    want = 2.0 * 2e5 * 0.1 * L * 0.02
    np.testing.assert_allclose(np.diff(content), want, rtol=1e-9)
    assert 1e-3 * np.abs(s).max() > 0.05


@pytest.mark.full
def test_enthalpy_rises_by_the_heat_that_enters() -> None:
    """H = integral of rho (500 s + 0.25 s^2), s = T - 300 K, of a well conducting slab."""
    gaps = []
    for h in (4.0, 2.0):
        run = slab(4, 80.0, h, material={**STORING, "k": 1e7}, loads=HEATED, integrator="bdf2")
        rise = last(run)[1].mean() - 300.0
        enthalpy = RHO * (500.0 * rise + 0.25 * rise**2) * 0.1 * L * L * 0.02
        gaps.append(abs(enthalpy / (80.0 * 2e5 * 0.1 * L * 0.02) - 1.0))
    assert max(gaps) < 1e-4, gaps


@pytest.mark.full
def test_a_lumped_capacity_stores_the_heat_at_the_nodes() -> None:
    """Sum of the rows: sum of C_i (H(T_i) - H(T_i before)) / c_0 = h q A."""
    run = slab(20, 40.0, 2.0, material=STORING, loads=HEATED, capacity="lumped")
    T, C = run.block("slab.thermal"), run.model.separated.heat[0].capacity.diagonal()
    s = T - 300.0
    stored = np.diff((C * (s + 0.5e-3 * s**2)).sum(axis=1))
    np.testing.assert_allclose(stored, 2.0 * 2e5 * 0.1 * L * 0.02, rtol=1e-9)


# ---------------------------------------------------------------------- elasticity


SOFTENING = {"temperatures": [293.15, 573.15, 873.15, 1073.15],
             "values": [2.1e11, 1.7e11, 0.65e11, 0.2e11]}
STRETCHING = {"polynomial": [1.2e-5, 4e-9], "origin": 293.15, "range": [200.0, 1200.0]}


def modulus(T: float) -> float:
    return float(np.interp(T, SOFTENING["temperatures"], SOFTENING["values"]))


def strain(T: float) -> float:
    return (1.2e-5 + 4e-9 * (T - 293.15)) * (T - 293.15)


def bar(T: float, fields: list[str], hold: dict[str, str], **options: Any) -> FloatArray:
    """(N, 2) static displacements of a bar at a uniform temperature, and its points."""
    loads = options.pop("loads", {})
    body = {"use": "flexible", "frame": "fixed", "fields": fields, "thickness": 0.02,
            "mesh": {"use": "rectangle", "size": [0.2, 0.02], "divisions": [8, 2]},
            "reference": {"hold": hold}, "initial_temperature": T,
            "material": {"rho": 7850, "E": SOFTENING, "nu": 0.3, "alpha": STRETCHING,
                         "k": 40, "c": 500}, **options}
    run = march(scene_of({"bodies": {"bar": body}, "loads": loads,
                          "time": {"end": 1.0, "step": 0.1}, "integrator": "bdf1"}))
    found: Any = run.model.parts["bar"]
    u = np.zeros(found.X.size)
    u[found.elasticity.free] = run.block("bar.elastic")[-1]
    return np.stack([found.X, u.reshape(-1, 2)])


FREE = {"left": "x", "bottom_left": "y"}
HOT, SET = ["elastic", "thermal"], ["elastic"]


@pytest.mark.full
@pytest.mark.parametrize("fields, T", [(HOT, 400.0), (SET, 1000.0)], ids=["hot", "set"])
def test_a_free_bar_expands_by_its_mean_coefficient(fields: list[str], T: float) -> None:
    X, u = bar(T, fields, FREE)
    np.testing.assert_allclose(u, strain(T) * X, rtol=0, atol=1e-9 * strain(T) * 0.2)


def test_a_hot_bar_under_tension_is_as_soft_as_its_modulus() -> None:
    pull = {"pull": {"use": "traction", "on": ["bar:right"], "traction": [1e8, 0.0]}}
    X, u = bar(1000.0, SET, FREE, loads=pull)
    want = strain(1000.0) + 1e8 / modulus(1000.0)
    np.testing.assert_allclose(u[:, 0], want * X[:, 0], rtol=0, atol=1e-8 * want * 0.2)


@pytest.mark.full
@pytest.mark.parametrize("fields", [HOT, SET], ids=["hot", "set"])
def test_a_clamped_bar_of_two_materials_shares_its_thermal_stress(fields: list[str]) -> None:
    """Half of another material between two walls: one stress, total elongation zero. Without
    displacements across, and nu = 0, the bar is one-dimensional."""
    other = {"rho": 7850, "E": 1e11, "nu": 0.0, "alpha": 2e-5, "k": 40, "c": 500}
    first = {"rho": 7850, "E": SOFTENING, "nu": 0.0, "alpha": STRETCHING, "k": 40, "c": 500}
    X, u = bar(800.0, fields, {"left": "x", "right": "x", "all": "y"}, material=first,
               sets={"half": {"where": "x > 0.0999"}, "all": {"where": "x >= 0"}},
               materials={"half": other})
    E, of_one, of_two = modulus(800.0), strain(800.0), 2e-5 * (800.0 - 293.15)
    stress = -(of_one + of_two) / (1 / E + 1 / 1e11)
    middle = np.abs(X[:, 0] - 0.1) < 1e-9
    np.testing.assert_allclose(u[middle, 0], 0.1 * (of_one + stress / E), rtol=1e-8)
    assert stress < -1e8


