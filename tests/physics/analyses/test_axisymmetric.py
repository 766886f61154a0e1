"""Bodies of revolution against closed forms of cylinders and disks (Timoshenko and Goodier 1970,
Theory of Elasticity, Sec. 28, 32 and 150)."""

from typing import Any

import numpy as np
import pytest

from analysed import NU, RHO, E, value
from sparsemor import InputError, Scene, load, simulate, solve

A, B, H, ALPHA, CONDUCTS = 0.1, 0.2, 0.002, 1.2e-5, 45.0


def ring(
    fields: list[str], hold: Any = None, joints: Any = None, loads: Any = None,
    reducer: Any = "full", cells: tuple[int, int] = (16, 1), **options: Any,
) -> Scene:
    body = {"use": "flexible", "axisymmetric": True, "frame": "fixed", "order": 2, "fields": fields,
            "mesh": {"use": "rectangle", "lower": [A, 0.0], "size": [B - A, H],
                     "divisions": list(cells)},
            "material": {"E": E, "nu": NU, "rho": RHO, "alpha": ALPHA, "k": CONDUCTS, "c": 460.0},
            "reference": {"hold": hold or {"bottom": "y"}}, **options}
    if "elastic" not in fields:
        del body["reference"]
    return load({"format": 1, "bodies": {"disk": body}, "joints": joints or {},
                 "loads": loads or {}, "time": {"end": 10.0, "step": 1.0}, "reducer": reducer,
                 "probes": {"bore": {"body": "disk", "at": [A, 0.0]},
                            "rim": {"body": "disk", "at": [B, 0.0]}}})


def hoop(solution: Any, x: float) -> float:
    """Hoop stress at the bottom of the section."""
    run = solution.result
    node = np.abs(run.points("disk") - [x, 0.0]).sum(axis=1).argmin()
    return float(run.stress("disk", 0)[node, 2, 2])


def test_a_thick_cylinder_under_pressure() -> None:
    p = 1e7
    found = solve(ring(["elastic"], {"bottom": "y", "top": "y"}, loads={
        "oil": {"use": "pressure", "on": ["disk:left"], "pressure": p}}), "static")
    share = p * A**2 / (B**2 - A**2)
    for name, r in (("bore", A), ("rim", B)):
        exact = (1.0 + NU) / E * share * ((1.0 - 2.0 * NU) * r + B**2 / r)
        assert value(found, f"{name}.u_x") == pytest.approx(exact, rel=1e-4)
        assert hoop(found, r) == pytest.approx(share * (1.0 + B**2 / r**2), rel=5e-3)


@pytest.mark.full
def test_a_spinning_annular_disk_and_its_reduced_model() -> None:
    spin = 800.0
    loads = {"spin": {"use": "centrifugal", "body": "disk", "spin": spin}}
    found = solve(ring(["elastic"], loads=loads), "static")
    exact = 0.25 * RHO * spin**2 * ((3.0 + NU) * B**2 + (1.0 - NU) * A**2)
    assert hoop(found, A) == pytest.approx(exact, rel=5e-3)
    basis = {"use": "modal", "count": 3, "correction": True}
    reduced = solve(ring(["elastic"], loads=loads, reducer={"use": "galerkin", "basis": basis}),
                    "static")
    assert value(reduced, "bore.u_x") == pytest.approx(value(found, "bore.u_x"), rel=1e-9)


@pytest.mark.full
def test_a_hollow_cylinder_conducts_heat_and_its_thermal_stress(tmp_path: Any) -> None:
    ends = {"hot": {"use": "prescribed_temperature", "on": ["disk:left"], "temperature": 393.15},
            "cold": {"use": "prescribed_temperature", "on": ["disk:right"],
                     "temperature": 293.15}}
    scene = ring(["elastic", "thermal"], joints=ends)
    heat = solve(scene, "steady_heat", out=tmp_path / "heat")
    r = np.linspace(A, B, 20001)
    rise = 100.0 * np.log(B / r) / np.log(B / A)
    run = heat.result
    assert run is not None
    np.testing.assert_allclose(
        run.nodal_temperature("disk", 0), 293.15 + np.interp(run.points("disk")[:, 0], r, rise),
        atol=0.01)
    warm = solve(scene.using({"initial": {"result": str(tmp_path / "heat")}}), "static")
    mean = 2.0 / (B**2 - A**2) * np.trapezoid(rise * r, r)
    assert hoop(warm, A) == pytest.approx(ALPHA * E * (mean - 100.0), rel=5e-3)
    assert hoop(warm, B) == pytest.approx(ALPHA * E * mean, rel=5e-3)


@pytest.mark.full
def test_a_disk_warms_by_the_heat_that_enters() -> None:
    lamp = {"lamp": {"use": "heat_flux", "on": ["disk:right"], "flux": 1e4}}
    run = simulate(ring(["thermal"], loads=lamp, cells=(64, 1)))
    m = RHO * 460.0 * np.pi * (B**2 - A**2) * H
    T = run.nodal_temperature("disk", -1)
    x, r = run.points("disk"), np.linspace(A, B, 2001)
    bottom = np.flatnonzero(x[:, 1] == 0.0)
    order = bottom[np.argsort(x[bottom, 0])]
    mean = np.trapezoid(np.interp(r, x[order, 0], T[order]) * r, r) * 2.0 / (B**2 - A**2)
    assert mean - 293.15 == pytest.approx(1e4 * 2.0 * np.pi * B * H * 10.0 / m, rel=2e-3)


def test_the_full_disk_has_no_motion_across_its_axis() -> None:
    spin = 800.0
    scene = ring(["elastic"], loads={"spin": {
        "use": "centrifugal", "body": "disk", "spin": spin}}).using({
            "bodies.disk.mesh": {"use": "rectangle", "size": [B, H], "divisions": [20, 1]},
            "probes.bore.at": [0.0, 0.0]})
    found = solve(scene, "static")
    assert value(found, "bore.u_x") == 0.0
    assert hoop(found, 0.0) == pytest.approx(
        (3.0 + NU) / 8.0 * RHO * spin**2 * B**2, rel=0.01)


@pytest.mark.parametrize("options, words", [
    ({"frame": "floating"}, "frame"), ({"thickness": 0.1}, "thickness"),
    ({"strains": "nonlinear"}, "strains"), ({"model": "plane_stress"}, "model"),
    ({"mesh": {"use": "rectangle", "lower": [-0.1, 0.0], "size": [0.2, 0.1],
               "divisions": [4, 2]}}, "negative"),
    ({"mesh": {"use": "block", "size": [0.2, 0.1, 0.1], "divisions": [2, 2, 2]}}, "3-D"),
    ({"reference": {"hold": {"left": "x"}}}, "along its axis")])
def test_what_a_body_of_revolution_is_not(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        solve(ring(["elastic"], loads={"spin": {"use": "centrifugal", "body": "disk",
                                                "spin": 1.0}}, **options), "static")


@pytest.mark.parametrize("loads, words", [
    ({"push": {"use": "point_force", "on": "disk:left", "force": [1.0, 0.0]}}, "a ring"),
    ({"weight": {"use": "gravity", "g": [9.81, 0.0]}}, "along its axis")])
def test_loads_that_are_not_axisymmetric(loads: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        solve(ring(["elastic"], loads=loads), "static")


def test_only_bodies_of_revolution_have_this_centrifugal_force() -> None:
    scene = ring(["elastic"], loads={"spin": {"use": "centrifugal", "body": "disk", "spin": 1.0}})
    with pytest.raises(InputError, match="not axisymmetric"):
        solve(scene.using({"bodies.disk.axisymmetric": False, "bodies.disk.thickness": 0.01,
                           "bodies.disk.reference": {"clamp": "left"}}), "static")
