"""Orthotropic material against closed forms, and against the isotropic one with equal numbers."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from sparsemor import InputError, load, solve

E1, E2, E3, NU12, NU13, NU23 = 120e9, 9e9, 8e9, 0.3, 0.28, 0.4
G12, G13, G23 = 5e9, 4.5e9, 3e9
WOOD: dict[str, Any] = {
    "use": "orthotropic", "rho": 1600, "E": [E1, E2, E3], "nu": [NU12, NU13, NU23],
    "G": [G12, G13, G23], "alpha": [1e-6, 3e-5, 2e-5], "k": [40.0, 5.0, 2.0], "c": 900.0}


def scene(body: dict[str, Any], loads: Any = None, joints: Any = None, reducer: Any = "full",
          probes: Any = None) -> Any:
    return load({"format": 1, "bodies": {"b": {"use": "flexible", "order": 2, "frame": "fixed",
                                               **body}},
                 "loads": loads or {}, "joints": joints or {}, "probes": probes or {},
                 "time": {"end": 1.0, "step": 0.1}, "reducer": reducer})


def bar(dimension: int, material: dict[str, Any], **options: Any) -> dict[str, Any]:
    L, h = 0.2, 0.02
    mesh = {"use": "rectangle", "size": [L, h], "divisions": [6, 1]} if dimension == 2 else {
        "use": "block", "size": [L, h, h], "divisions": [4, 1, 1]}
    chord = ["bottom_left", "bottom_right"] if dimension == 2 else [
        "left_front_bottom", "right_front_bottom", "left_back_bottom"]
    return {"mesh": mesh, "material": material, "fields": ["elastic"],
            "reference": {"chord": chord}, **({"thickness": 0.01} if dimension == 2 else {}),
            **options}


@pytest.mark.full
@pytest.mark.parametrize("dimension, angle", [(2, np.pi / 2.0), (2, 0.5), (3, 0.5)])
def test_the_modulus_of_turned_axes(dimension: int, angle: float) -> None:
    c, s = np.cos(angle), np.sin(angle)
    modulus = 1.0 / (c**4 / E1 + s**4 / E2 + (1.0 / G12 - 2.0 * NU12 / E1) * s**2 * c**2)
    zero = [0.0] * (dimension - 1)
    pull = {"use": "traction", "on": ["b:right"], "traction": [1e6, *zero]}
    back = {"use": "traction", "on": ["b:left"], "traction": [-1e6, *zero]}
    corner = "bottom_right" if dimension == 2 else "right_front_bottom"
    found = solve(scene(bar(dimension, {**WOOD, "angle": angle}), {"pull": pull, "back": back},
                        probes={"end": {"body": "b", "at": corner}}), "static")
    u = next(r["value"] for r in found.rows if r["quantity"] == "end.u_x")
    assert u == pytest.approx(1e6 * 0.2 / modulus, rel=1e-8)
    run = found.result
    assert run is not None
    stress = np.zeros((3, 3))
    stress[0, 0] = 1e6
    np.testing.assert_allclose(run.stress("b", 0), np.broadcast_to(
        stress, run.stress("b", 0).shape), atol=1.0)
    # tension along x does not change the thickness across 3 more than nu allows
    across = (NU13 / E1 * c**2 + NU23 / E2 * s**2) * 1e6
    np.testing.assert_allclose(run.strain("b", 0)[:, 2, 2], -across, rtol=1e-6)


@pytest.mark.full
@pytest.mark.parametrize("dimension", [2, 3])
def test_free_expansion_has_no_stress(dimension: int) -> None:
    body = bar(dimension, {**WOOD, "angle": 0.5}, initial_temperature=393.15)
    run = solve(scene(body), "static").result
    assert run is not None
    c, s = np.cos(0.5), np.sin(0.5)
    np.testing.assert_allclose(run.strain("b", 0)[:, 0, 0],
                               100.0 * (1e-6 * c * c + 3e-5 * s * s), rtol=1e-8)
    np.testing.assert_allclose(run.strain("b", 0)[:, 2, 2], 100.0 * 2e-5, rtol=1e-8)
    assert np.abs(run.stress("b", 0)).max() < 1e-7 * E1 * 3e-3


@pytest.mark.full
@pytest.mark.parametrize("model", ["plane_strain", None])
def test_equal_numbers_are_isotropic(model: str | None, tmp_path: Path) -> None:
    E, nu = 2.1e11, 0.3
    iso = {"E": E, "nu": nu, "rho": 7800, "alpha": 1.2e-5, "k": 45.0, "c": 460.0}
    same = {"use": "orthotropic", "rho": 7800, "E": [E] * 3, "nu": [nu] * 3,
            "G": [E / 2.0 / (1.0 + nu)] * 3, "alpha": [1.2e-5] * 3, "k": [45.0] * 3, "c": 460.0,
            "angle": 0.7, "axis": [0.0, 0.0, 1.0]}
    d = 3 if model is None else 2
    push = {"use": "traction", "on": ["b:right"], "traction": [2e6, -1e5, 1e5][:d]}
    found = {}
    for name, material in (("iso", iso), ("same", same)):
        body = bar(d, material, reference={"clamp": "left"}, initial_temperature=303.15,
                   fields=["elastic"], **({"model": model} if model else {}))
        run = solve(scene(body, {"push": push}), "static").result
        assert run is not None
        found[name] = [run.stress("b", 0), run.strain("b", 0), solve(
            scene(body, {"push": push}), "frequencies", count=3).column("frequency_hz"), solve(
            scene(body, {"push": {**push, "traction": [-2e6, *[0.0] * (d - 1)]}}), "buckling",
            count=1).column("factor")]
    for one, two in zip(found["iso"], found["same"], strict=True):
        np.testing.assert_allclose(two, one, rtol=1e-6, atol=1e-9 * np.abs(one).max())


def test_heat_flows_across_the_layers() -> None:
    """Along an insulated bar with turned axes: k_xx - k_xy^2 / k_yy."""
    c, s = np.cos(0.5), np.sin(0.5)
    kxx, kyy, kxy = 40 * c * c + 5 * s * s, 40 * s * s + 5 * c * c, 35 * s * c
    mesh = {"use": "rectangle", "size": [0.2, 0.004], "divisions": [100, 2]}
    body = {"mesh": mesh, "material": {**WOOD, "angle": 0.5}, "fields": ["thermal"],
            "thickness": 0.01}
    joints = {"cold": {"use": "prescribed_temperature", "on": ["b:left"], "temperature": 293.15}}
    loads = {"lamp": {"use": "heat_flux", "on": ["b:right"], "flux": 1000.0}}
    probes = {"near": {"body": "b", "at": [0.05, 0.0]}, "far": {"body": "b", "at": [0.15, 0.0]}}
    found = solve(scene(body, loads, joints, probes=probes), "steady_heat")
    near, far = (next(r["value"] for r in found.rows if r["quantity"] == f"{p}.temperature")
                 for p in ("near", "far"))
    assert far - near == pytest.approx(1000.0 * 0.1 / (kxx - kxy**2 / kyy), rel=1e-6)


@pytest.mark.full
def test_a_simply_supported_orthotropic_plate(tmp_path: Path) -> None:
    """omega = pi^2 sqrt((D11 / a^4 + 2 (D12 + 2 D66) / a^2 b^2 + D22 / b^4) / rho h) (Reddy 2003,
    Mechanics of Laminated Composite Plates and Shells, Sec. 5.5)."""
    a, b, h, n = 0.4, 0.3, 0.004, 8
    x, y = np.linspace(0, a, n + 1), np.linspace(0, b, n + 1)
    points = np.stack(np.meshgrid(x, y, [0.0, h / 2, h], indexing="ij"), axis=-1).reshape(-1, 3)
    at = np.arange(len(points)).reshape(n + 1, n + 1, 3)
    cells = np.stack([at[i : i + n, j : j + n, k : k + 2] for k in (0, 1) for i, j in (
        (0, 0), (1, 0), (1, 1), (0, 1))], axis=-1).reshape(-1, 8)
    meshio.write_points_cells(tmp_path / "plate.vtk", points, [("hexahedron", cells)])
    edge = f"abs(z - {h / 2}) < 1e-9 and (x < 1e-9 or x > {a - 1e-9} or y < 1e-9 or y > {b - 1e-9})"
    body = {"mesh": {"use": "file", "path": str(tmp_path / "plate.vtk")}, "material": WOOD,
            "fields": ["elastic"], "sets": {"edge": {"where": edge}},
            "reference": {"clamp": "edge"}}
    found = solve(scene(body), "frequencies", count=1)
    n21 = NU12 * E2 / E1
    D = h**3 / 12.0 / (1.0 - NU12 * n21)
    D11, D22, D12, D66 = E1 * D, E2 * D, n21 * E1 * D, G12 * h**3 / 12.0
    exact = np.pi**2 * np.sqrt((D11 / a**4 + 2.0 * (D12 + 2.0 * D66) / (a * b) ** 2
                                + D22 / b**4) / (1600 * h))
    assert found.column("imaginary_per_s")[0] == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize("changes, words", [
    ({"material": {**WOOD, "nu": [3.6, 0.28, 0.4]}}, "energy"),
    ({"material": {k: v for k, v in WOOD.items() if k != "G"}}, "E, nu and G"),
    ({"material": {**WOOD, "axis": [0.0, 0.0, 0.0]}}, "zero"),
    ({"strains": "nonlinear"}, "direction")])
def test_what_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        solve(scene({**bar(2, WOOD), **changes}), "static")
