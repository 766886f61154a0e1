"""Steady temperatures against closed forms."""

from pathlib import Path

import numpy as np
import pytest

from analysed import fin, value
from sparsemor import InputError, simulate, solve

ROOT = {"root": {"use": "prescribed_temperature", "on": ["fin:left"], "temperature": 373.15}}
AIR = {"air": {"use": "convection", "on": ["fin:top", "fin:bottom"], "film": 50.0,
               "temperature": 293.15}}


def test_a_fin_with_convection() -> None:
    found = solve(fin(AIR, ROOT), "steady_heat")
    m = np.sqrt(2.0 * 50.0 / (200.0 * 0.002))
    assert value(found, "tip.temperature") == pytest.approx(
        293.15 + 80.0 / np.cosh(0.1 * m), rel=2e-5)


def test_a_bar_that_radiates_at_its_end() -> None:
    radiation = {"sky": {"use": "radiation", "on": ["fin:right"], "emissivity": 0.8,
                         "surroundings": 0.0}}
    hot = {"root": {**ROOT["root"], "temperature": 1500.0}}
    found = solve(fin(radiation, hot, k=20.0), "steady_heat")
    T = value(found, "tip.temperature")
    # conduction to the end equals its radiation
    assert 20.0 * (1500.0 - T) / 0.1 == pytest.approx(0.8 * 5.670374419e-8 * T**4, rel=1e-6)


@pytest.mark.full
def test_conductivity_that_depends_on_temperature() -> None:
    """Kirchhoff: between k1 at T1 and k2 at T2, linear in T, the heat flow is that of the mean."""
    ends = {"hot": {**ROOT["root"], "temperature": 500.0},
            "cold": {**ROOT["root"], "on": ["fin:right"], "temperature": 300.0}}
    scene = fin({}, ends, k={"temperatures": [250.0, 600.0], "values": [100.0, 240.0]})
    found = solve(scene.using({"probes.tip.at": [0.05, 0.0]}), "steady_heat")
    k = lambda T: 100.0 + 0.4 * (T - 250.0)  # noqa: E731
    T = value(found, "tip.temperature")
    flows = [(k(a) + k(b)) / 2.0 * (a - b) for a, b in ((500.0, T), (T, 300.0))]
    assert flows[0] == pytest.approx(flows[1], rel=1e-6)


@pytest.mark.full
def test_reduced_heat() -> None:
    basis = {"use": "modal", "count": 6, "correction": True}
    full = value(solve(fin(AIR, ROOT), "steady_heat"), "tip.temperature")
    reduced = solve(fin(AIR, ROOT, reducer={"use": "galerkin", "basis": basis}), "steady_heat")
    assert value(reduced, "tip.temperature") == pytest.approx(full, rel=1e-9)


@pytest.mark.full
def test_heat_without_a_sink_is_refused() -> None:
    lamp = {"lamp": {"use": "heat_flux", "on": ["fin:top"], "flux": 10.0}}
    for reducer in ("full", {"use": "galerkin", "basis": {"use": "modal", "count": 4}}):
        with pytest.raises(InputError, match="no heat leaves fin"):
            solve(fin(lamp, {}, reducer), "steady_heat")


@pytest.mark.full
def test_a_run_starts_from_steady_heat_and_stays(tmp_path: Path) -> None:
    scene = fin(AIR, ROOT)
    found = solve(scene, "steady_heat", out=tmp_path / "heat")
    run = simulate(scene.using({"initial": {"result": str(tmp_path / "heat")}}))
    np.testing.assert_allclose(
        run.probe("tip")[:, -1], value(found, "tip.temperature"), rtol=1e-9)
