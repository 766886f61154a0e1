"""Eigenfrequencies against closed forms: beams, plates, pendulums, oscillators, rotating bodies."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from analysed import NU, RHO, E, beam
from sparsemor import InputError, load, solve


@pytest.mark.full
def test_a_slender_cantilever() -> None:
    found = solve(beam(height=0.02, cells=(20, 1)), "frequencies", count=3)
    slim = np.sqrt(E * 0.02**2 / 12.0 / RHO)
    exact = [b**2 * slim / (2.0 * np.pi) for b in (1.875104, 4.694091, 7.854757)]
    # 0.3 %: the clamp holds the sides, and shear softens the third mode by 0.5 %
    np.testing.assert_allclose(found.column("frequency_hz"), exact, rtol=5e-3)
    assert found.result is not None and len(found.result.times) == 4


@pytest.mark.full
def test_rayleigh_damping_gives_the_ratios() -> None:
    still = solve(beam(), "frequencies", count=3)
    found = solve(beam(damping={"mass": 3.0, "stiffness": 1e-5}), "frequencies", count=3)
    w = np.array(still.column("imaginary_per_s"))
    np.testing.assert_allclose(found.column("damping_ratio"), 1.5 / w + 5e-6 * w, rtol=1e-6)
    np.testing.assert_allclose(
        np.hypot(found.column("real_per_s"), found.column("imaginary_per_s")), w, rtol=1e-6)


@pytest.mark.full
def test_reduced_beams_have_the_modes_of_their_trial_space() -> None:
    full = solve(beam(), "frequencies", count=3).column("frequency_hz")
    for reducer in ({"use": "galerkin", "basis": {"use": "modal", "count": 6}},
                    {"use": "sparse", "basis": {"use": "modal", "count": 6}}):
        reduced = solve(beam(reducer=reducer), "frequencies", count=3)
        np.testing.assert_allclose(reduced.column("frequency_hz"), full, rtol=1e-7)


def test_a_damped_oscillator() -> None:
    m, k, c = 2.0, 5000.0, 12.0
    scene = load({
        "format": 1, "bodies": {"b": {"use": "rigid", "mass": m, "inertia": 0.1,
                                      "points": {"o": [0.0, 0.0]}}},
        "joints": {"guide": {"use": "prismatic", "between": ["ground", "b:o"], "axis": [1.0, 0.0]},
                   "spring": {"use": "spring_damper", "between": ["ground", "b:o"],
                              "ground": [-1.0, 0.0], "stiffness": k, "damping": c, "length": 1.0}},
        "time": {"end": 0.1, "step": 1e-3}})
    (row,) = solve(scene, "frequencies", count=1).rows
    w = np.sqrt(k / m)
    assert row["damping_ratio"] == pytest.approx(c / (2.0 * np.sqrt(k * m)), rel=1e-9)
    assert row["frequency_hz"] * 2.0 * np.pi == pytest.approx(
        w * np.sqrt(1.0 - row["damping_ratio"] ** 2), rel=1e-9)


@pytest.mark.full
def test_a_pendulum_swings_about_its_equilibrium() -> None:
    scene = load({
        "format": 1, "bodies": {"b": {"use": "rigid", "mass": 3.0, "inertia": 0.2,
                                      "points": {"o": [-0.5, 0.0]},
                                      "pose": {"position": [0.5, 0.0]}}},
        "joints": {"hinge": {"use": "revolute", "between": ["ground", "b:o"]}},
        "loads": {"weight": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": 0.1, "step": 1e-3}})
    (row,) = solve(scene, "frequencies", count=1).rows
    w = np.sqrt(3.0 * 9.81 * 0.5 / (0.2 + 3.0 * 0.25))
    assert row["frequency_hz"] == pytest.approx(w / (2.0 * np.pi), rel=1e-8)
    up = solve(scene.using({"bodies.b.pose": {"position": [0.0, 0.5], "angle": np.pi / 2.0}}),
               "frequencies", count=1, about="start")
    assert up.rows[0]["real_per_s"] == pytest.approx(w, rel=1e-6)  # upside down
    assert "unstable" in [n.kind for n in up.notes]


@pytest.mark.full
@pytest.mark.parametrize("gamma, flap, strains", [
    (2.0, 4.1373, "nonlinear"), (6.0, 7.3604, "prestressed"), (12.0, 13.1702, "nonlinear"),
    (12.0, 13.1702, "prestressed")])
def test_a_spinning_beam(gamma: float, flap: float, strains: str) -> None:
    """In the plane of rotation, without a hub: (flap^2 - gamma^2)^(1/2) with the flapping
    frequencies of Wright et al. (1982), doi 10.1115/1.3161966, Table 1, times sqrt(E I / m L^4)."""
    scale = np.sqrt(E * 0.02**2 / 12.0 / RHO)
    turn = {"use": "ramp", "end": 10.0, "final": 10.0 * gamma * scale}
    scene = beam(height=0.02, cells=(20, 1), strains=strains, frame="floating", joints={
        "hub": {"use": "prescribed_motion", "of": "beam:left", "x": 0.0, "y": 0.0, "angle": turn}})
    found = solve(scene, "frequencies", count=1, spin=True)
    assert found.column("imaginary_per_s")[0] / scale == pytest.approx(
        np.sqrt(flap**2 - gamma**2), rel=4e-3)


def test_a_free_top_precesses_at_eulers_rate() -> None:
    spin, along, across = 50.0, 0.5, 0.3
    scene = load({
        "format": 1, "bodies": {"b": {
            "use": "rigid", "mass": 2.0, "inertia": [across, across, along],
            "pose": {"spin": [0.0, 0.0, spin], "position": [1.0, 2.0, 3.0], "angle": 0.7}}},
        "time": {"end": 0.1, "step": 1e-3}})
    found = solve(scene, "frequencies", count=6, spin=True, about="start")
    rates = np.array(found.column("imaginary_per_s"))
    assert np.abs(rates - spin * (along - across) / across).min() < 1e-6
    # a body at rest, seen from the turning axes: defective, so that rounding moves it by its root
    assert np.abs(rates - spin).min() < 1e-2


@pytest.mark.full
def test_a_free_body_in_space_has_six_rigid_motions() -> None:
    scene = load({
        "format": 1, "bodies": {"b": {
            "use": "flexible", "order": 2, "fields": ["elastic"],
            "reference": {"chord": ["left_front_bottom", "right_front_bottom", "left_back_bottom"]},
            "mesh": {"use": "block", "size": [0.5, 0.02, 0.03], "divisions": [12, 1, 1]},
            "material": {"E": E, "nu": NU, "rho": RHO}}}, "time": {"end": 0.1, "step": 1e-3}})
    found = solve(scene, "frequencies", count=8)
    assert found.column("rigid") == [True] * 6 + [False] * 2
    exact = 4.730041**2 * np.sqrt(E * 0.02**2 / 12.0 / RHO) / 0.5**2 / (2.0 * np.pi)
    assert found.column("frequency_hz")[6] == pytest.approx(exact, rel=0.01)


@pytest.mark.full
def test_a_free_square_plate(tmp_path: Path) -> None:
    """omega a^2 sqrt(rho h / D) = 13.468, 19.596, 24.270 (Leissa 1973, doi
    10.1016/S0022-460X(73)80371-2, case 21, nu = 0.3)."""
    a, h, n = 0.5, 0.005, 8
    x, z = np.linspace(0.0, a, n + 1), np.array([0.0, h])
    points = np.stack(np.meshgrid(x, x, z, indexing="ij"), axis=-1).reshape(-1, 3)
    at = np.arange(len(points)).reshape(n + 1, n + 1, 2)
    cells = np.stack([at[:-1, :-1, 0], at[1:, :-1, 0], at[1:, 1:, 0], at[:-1, 1:, 0],
                      at[:-1, :-1, 1], at[1:, :-1, 1], at[1:, 1:, 1], at[:-1, 1:, 1]], axis=-1)
    meshio.write_points_cells(
        tmp_path / "plate.vtk", points, [("hexahedron", cells.reshape(-1, 8))])
    scene = load({
        "format": 1, "bodies": {"plate": {
            "use": "flexible", "order": 2, "fields": ["elastic"],
            "reference": {"chord": ["a", "b", "c"]},
            "mesh": {"use": "file", "path": str(tmp_path / "plate.vtk")},
            "sets": {"a": {"nearest": [0.0, 0.0, 0.0]}, "b": {"nearest": [a, 0.0, 0.0]},
                     "c": {"nearest": [0.0, a, 0.0]}},
            "material": {"E": E, "nu": NU, "rho": RHO}}}, "time": {"end": 0.1, "step": 1e-3}})
    found = solve(scene, "frequencies", count=9)
    scale = a**2 * np.sqrt(RHO * h / (E * h**3 / 12.0 / (1.0 - NU**2)))
    np.testing.assert_allclose(np.array(found.column("imaginary_per_s")[6:]) * scale,
                               [13.468, 19.596, 24.270], rtol=0.015)


def test_what_has_no_modes_is_refused() -> None:
    turn = {"use": "prescribed_motion", "of": "b:o", "x": 0.0, "y": 0.0, "angle": 0.0}
    scene = load({
        "format": 1, "bodies": {"b": {"use": "rigid", "mass": 1.0, "inertia": 0.2,
                                      "points": {"o": [0.0, 0.0]}}},
        "joints": {"hub": turn}, "time": {"end": 0.1, "step": 1e-3}})
    with pytest.raises(InputError, match="every motion is held"):
        solve(scene, "frequencies")
    with pytest.raises(InputError, match="no such option"):
        solve(scene, "frequencies", modes=3)
    with pytest.raises(InputError, match="did you mean"):
        solve(scene, "frequenzies")
