"""Storage of heat in materials whose heat content is any function of temperature: what goes in is
stored, in every step, also across a peak by latent heat."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from sparsemor import load, simulate
from sparsemor.bodies.fem.integrals import on_cells
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.bodies.terms.law_functions import integral_at, with_integrals

ALPHA = {"use": "generalized_alpha", "rho_inf": 0.8}
PEAK = {"temperatures": [293.15, 1000.0, 1002.0, 1004.0, 1006.0, 2000.0],
        "values": [500.0, 500.0, 60500.0, 60500.0, 500.0, 500.0]}
"""500 J/(kg K) and a peak of 240 kJ/kg within 6 K."""
END = 293.15 + (50000.0 * 2 * 0.02 * 600.0 / (7850.0 * 0.02 * 0.01) - 240e3) / 500.0
"""K, from the balance of heat: flux times area and time = rho volume (500 rise + 240 kJ/kg)."""


def melted(**changes: Any) -> Any:
    tree = {
        "format": 1,
        "bodies": {"b": {
            "use": "flexible", "mesh": {"use": "rectangle", "size": [0.02, 0.01],
                                        "divisions": [2, 2]}, "thickness": 0.02,
            "material": {"rho": 7850.0, "k": 1e4, "c": PEAK}, "fields": ["thermal"],
            "frame": "fixed"}},
        "loads": {"q": {"use": "heat_flux", "on": ["b:top", "b:bottom"], "flux": 5e4}},
        "time": {"end": 600.0, "step": 20.0}, "integrator": "bdf2", "reducer": "full"}
    return simulate(load(tree, changes))


def mean_end(run: Any) -> float:
    return float(run.nodal_temperature("b", -1)[run.cells("b")].mean())


def test_the_balance_of_heat_in_closed_form() -> None:
    assert pytest.approx(1341.8, abs=0.05) == END


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["bdf2", ALPHA], ids=["bdf2", "alpha"])
def test_latent_heat_is_stored_with_steps_that_miss_its_peak(integrator: Any) -> None:
    """cases/physics/latent: 1821.8 K before, with steps of 5 s."""
    assert mean_end(melted(integrator=integrator)) == pytest.approx(END, abs=0.01)


@pytest.mark.full
@pytest.mark.parametrize("integrator, step", [("bdf1", 20.0), ("bdf2", 5.0), (ALPHA, 20.0)],
                         ids=["bdf1", "bdf2", "alpha"])
def test_latent_heat_with_controlled_steps(integrator: Any, step: float) -> None:
    """Where the substep changes BDF2 begins anew: with a made history of temperatures it lost
    0.4 % of the rise (1337.7 K with steps of 5 s)."""
    run = melted(integrator=integrator, **{
        "time.step": step, "time.control": {"tolerance": 1e-3, "max_halvings": 12}})
    assert mean_end(run) == pytest.approx(END, abs=1e-3)


@pytest.mark.full
@pytest.mark.parametrize("narrow", [1.0, 0.02])
def test_newton_finds_the_state_beyond_a_peak(narrow: float) -> None:
    """Full steps alternate between the sides of the peak; the textbook method ended there at 280 s
    with steps of 20 s. The same heat within 6 and 0.12 K."""
    T = np.array(PEAK["temperatures"])
    T[2:5] = 1000.0 + narrow * (T[2:5] - 1000.0)
    c = 500.0 + (np.array(PEAK["values"]) - 500.0) / narrow
    run = melted(reducer={"use": "full", "method": "newton"}, **{
        "time.step": 40.0,
        "bodies.b.material.c": {"temperatures": T.tolist(), "values": c.tolist()}})
    assert mean_end(run) == pytest.approx(END, abs=0.01)


@pytest.mark.full
@pytest.mark.parametrize("reducer, integrator", [
    ("galerkin", "bdf1"), ("ecsw", "bdf2"), ("deim", "bdf1"), ("lspg", "bdf2")])
def test_reduced_models_store_it_too(reducer: str, integrator: str) -> None:
    run = melted(reducer=reducer, integrator=integrator)
    assert mean_end(run) == pytest.approx(END, abs=1.0)


@pytest.mark.full
def test_a_front_that_melts_with_few_atoms() -> None:
    """240 kJ/kg pass through a bar: Newton's steps alternated over the ends of the peak while the
    residual fell by less and less (`not_converged` at 39 s with bdf1)."""
    tree = {**BAR, "time": {"end": 150.0, "step": 3.0}, "integrator": "bdf1",
            "loads": {"q": {"use": "heat_flux", "on": ["b:left"], "flux": 3e5}},
            "bodies": {"b": {
                **BAR["bodies"]["b"], "initial_temperature": 900.0,  # type: ignore[index]
                "mesh": {"use": "rectangle", "size": [0.04, 0.01], "divisions": [24, 4]},
                "material": {"rho": 7850.0, "k": 40.0, "c": PEAK}}}}

    def ends(reducer: str, **changes: Any) -> tuple[Any, Any]:
        run = simulate(load(tree, {"reducer": reducer, **changes}))
        return run, run.nodal_temperature("b", -1).ravel()

    full = ends("full")[1]
    few = {"reducer.basis": {"use": "pod", "count": 10}}
    for reducer in ("galerkin", "gnat", "lspg", "deim", "ecsw"):
        run, T = ends(reducer, **few)
        assert np.abs(T - full).max() <= 0.01 * np.ptp(full), reducer
        assert balance(run)["share"] <= 2e-3, reducer


@pytest.mark.full
def test_melting_behind_a_jump_of_a_prescribed_temperature() -> None:
    """Points of negative weight took heat away at the peak, so that no step had a solution
    (`not_converged` at 29.7 s). The balance counts cells with prescribed nodes, too."""
    run = simulate(load({
        **BAR, "time": {"end": 35.0, "step": 0.1}, "integrator": "bdf1",
        "joints": {"h": {"use": "prescribed_temperature", "on": ["b:left"], "temperature": {
            "use": "table", "times": [20.3, 20.3001], "values": [293.15, 493.15]}}},
        "bodies": {"b": {
            **BAR["bodies"]["b"],  # type: ignore[index]
            "mesh": {"use": "rectangle", "size": [0.1, 0.02], "divisions": [20, 4]},
            "material": {"rho": 7850.0, "k": 45.0, "c": {
                "temperatures": [293.15, 400.0, 402.0, 404.0, 406.0, 2000.0],
                "values": [500.0, 500.0, 5000.0, 5000.0, 500.0, 500.0]}}}}}))
    assert balance(run)["share"] <= 1e-9


@pytest.mark.parametrize("mesh", [
    Rectangle(size=(1.0, 1.0), divisions=(2, 2)),
    BlockMesh(size=(1.0, 1.0, 1.0), divisions=(2, 2, 2))], ids=["plane", "space"])
def test_no_point_takes_heat_away(mesh: Any) -> None:
    for degree in (1, 2, 3, 4, 7):
        ((_, points),) = on_cells(mesh.build(Path()), degree, positive=True)
        assert points.weights.min() > 0.0
        assert points.weights.sum() == pytest.approx(1.0)


@pytest.mark.full
def test_a_table_of_the_heat_content() -> None:
    """Latent heat as a steep piece of H: the same as a peak of c of that area."""
    T = np.array(PEAK["temperatures"])
    H = TemperatureCurve(**PEAK).integral(T)
    run = melted(**{"bodies.b.material.c": {
        "temperatures": [293.15, 1000.0, 1006.0, 2000.0],
        "enthalpy": H[[0, 1, 4, 5]].tolist()}})
    assert mean_end(run) == pytest.approx(END, abs=0.01)


def balance(run: Any) -> Any:
    return run.summary["heat_balance"]["b.thermal"]


@pytest.mark.full
@pytest.mark.parametrize("integrator", ["bdf1", "bdf2"])
def test_the_balance_of_heat_is_part_of_the_result(integrator: Any) -> None:
    """24 kJ = flux, area and time. BDF2 is half a step behind, which is no loss."""
    found = balance(melted(integrator=integrator, **{"time.step": 40.0}))
    assert found["stored"] == pytest.approx(24e3, rel=1e-9)
    assert found["brought_in"] == pytest.approx(24e3, rel=1e-9)
    assert found["share"] <= 1e-9


BAR = {
    "format": 1,
    "bodies": {"b": {
        "use": "flexible", "mesh": {"use": "rectangle", "size": [0.1, 0.02], "divisions": [20, 2]},
        "thickness": 0.01, "material": {"rho": 7850.0, "k": 45.0, "c": 480.0},
        "fields": ["thermal"], "frame": "fixed"}},
    "time": {"end": 50.0, "step": 1.0}, "integrator": "bdf2", "reducer": "full"}
STEEL = {"rho": 7850.0,
         "k": {"polynomial": [54.0, -0.0333], "origin": 273.15, "range": [200.0, 1073.15]},
         "c": {"polynomial": [450.0, 0.28], "origin": 273.15, "range": [200.0, 1073.15]}}
PLAIN = {"rho": 7850.0, "k": 45.0, "c": 480.0}


def bar(loads: Any, **changes: Any) -> Any:
    return simulate(load({**BAR, "loads": loads}, changes))


PULSE = {"use": "heat_flux", "on": ["b:top"], "flux": {
    "use": "table", "times": [3.2, 3.2001, 9.7, 9.7001], "values": [0.0, 1e5, 1e5, 0.0]}}
FILM = {"use": "convection", "on": ["b:left"], "film": 500.0, "temperature": 273.15}
GREY = {"use": "radiation", "on": ["b:right"], "emissivity": 0.8, "surroundings": 600.0}
SINE = {"use": "sine", "amplitude": 5e4, "frequency": 0.02}


@pytest.mark.full
@pytest.mark.parametrize("reducer, material", [
    ("full", STEEL), ("galerkin", PLAIN), ("ecsw", STEEL), ("sparse", PLAIN)])
def test_right_runs_balance(reducer: str, material: Any) -> None:
    """A pulse off the step grid, a film and radiation that brings as much: no note."""
    run = bar({"q": PULSE, "f": FILM, "r": GREY}, reducer=reducer,
              **{"bodies.b.material": material})
    assert 0.0 <= balance(run)["share"] <= 1e-6
    assert "heat_balance" not in run.summary["note_kinds"]


@pytest.mark.full
def test_heat_that_rows_of_a_reduced_model_invent_is_noted() -> None:
    """Trained without the pulse: `sparse` solves its rows, and no heat is balanced."""
    ends = {n: {"use": "heat_flux", "on": [f"b:{n}"], "flux": {**SINE, "amplitude": a}}
            for n, a in (("left", 5e4), ("right", -5e4))}
    run = bar({"q": PULSE, **ends}, reducer="sparse", **{
        "training.overrides": {"loads.q.flux": 0.0}, "bodies.b.material": STEEL})
    found = balance(run)
    assert found["share"] > 0.1
    assert abs(found["stored"] - found["brought_in"]) > 0.1 * abs(found["brought_in"])
    assert "heat_balance" in run.summary["note_kinds"]


@pytest.mark.full
def test_no_balance_is_told_where_none_is_known() -> None:
    run = bar({"f": FILM}, **{"time.control": {"tolerance": 1e-2}})
    assert run.summary["heat_balance"] == {}


@pytest.mark.full
@pytest.mark.parametrize("changes, at", [
    ({"integrator": "bdf1"}, 10.37), ({"integrator": "bdf2"}, 10.0), ({"integrator": ALPHA}, 10.37),
    ({"reducer": "galerkin"}, 10.37),
    ({"time.control": {"tolerance": 1e-2, "max_halvings": 14}}, 10.0)],
    ids=["bdf1", "bdf2", "alpha", "galerkin", "control"])
def test_a_jump_of_a_prescribed_temperature(at: float, changes: Any) -> None:
    """An end of an insulated bar jumps by 200 K: the mean rises as the series of Fourier. By the
    slope of the function at the end of the step it was -1471 K, or the jump brought nothing."""
    a, L = 45.0 / (7850.0 * 480.0), 0.1
    odd = np.arange(1, 400, 2) * np.pi
    rise = 200.0 * (1.0 - float((8.0 / odd**2 * np.exp(
        -odd**2 * a * (50.0 - at) / (4.0 * L**2))).sum()))
    run = simulate(load({**BAR, "joints": {"h": {
        "use": "prescribed_temperature", "on": ["b:left"], "temperature": {
            "use": "table", "times": [at, at + 1e-3], "values": [293.15, 493.15]}}}}, changes))
    T = run.nodal_temperature("b", -1).reshape(-1)
    weights = np.zeros(len(T))
    np.add.at(weights, run.cells("b"), 1.0)
    assert np.average(T, weights=weights) - 293.15 == pytest.approx(rise, rel=0.015)


CURVES = {
    "table": TemperatureCurve(**PEAK),
    "polynomial": TemperatureCurve(polynomial=(450.0, 0.28, -2.91e-4, 1.34e-7), origin=273.15,
                                   range=(293.15, 1473.15)),
    "heat content": TemperatureCurve(temperatures=(300.0, 400.0, 410.0), enthalpy=(0.0, 4e4, 9e4)),
}


@pytest.mark.parametrize("curve", CURVES.values(), ids=list(CURVES))
def test_heat_content_is_the_integral_of_the_specific_heat(curve: TemperatureCurve) -> None:
    low, high = curve.limits
    T = np.linspace(low - 50.0, high + 50.0, 4001)
    c, H = curve.at(0.5 * (T[1:] + T[:-1]))[0], curve.integral(T)
    assert np.abs(np.cumsum(c * np.diff(T)) - (H[1:] - H[0])).max() <= 2e-3 * np.ptp(H)
    numbers = with_integrals(curve.numbers)
    by_numbers = [integral_at(numbers, 0, float(t)) for t in T[::97]]
    assert np.abs(by_numbers - H[::97]).max() <= 1e-12 * np.abs(H).max()


def test_a_heat_content_that_falls_is_refused() -> None:
    with pytest.raises(ValidationError, match="after 5 J/kg: the heat content must increase"):
        TemperatureCurve(temperatures=(300.0, 400.0), enthalpy=(5.0, 5.0))
