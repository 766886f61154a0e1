"""Linear buckling against closed forms: Euler columns, a plate, a rigid strut, a heated bar."""

from pathlib import Path

import numpy as np
import pytest

from analysed import NU, RHO, E, beam
from sparsemor import InputError, load, solve

H, W, L = 0.01, 0.02, 1.0
EULER = np.pi**2 * E * W * H**3 / 12.0 / L**2
PUSH = {"push": {"use": "point_force", "on": "beam:right", "force": [-1.0, 0.0]}}


def column(strains: str, loads: object = PUSH, **options: object):  # type: ignore[no-untyped-def]
    return beam(height=H, width=W, cells=(20, 1), strains=strains, loads=loads, **options)


@pytest.mark.full
@pytest.mark.parametrize("strains", ["linear", "nonlinear", "prestressed"])
def test_a_column_clamped_at_one_end(strains: str) -> None:
    found = solve(column(strains), "buckling", count=2)
    np.testing.assert_allclose(found.column("factor"), [EULER / 4.0, 9.0 * EULER / 4.0], rtol=8e-3)


@pytest.mark.full
@pytest.mark.parametrize("ends, strains, factor", [
    ("pinned", "nonlinear", 1.0), ("guided", "linear", 1.0), ("propped", "nonlinear", 2.0457)])
def test_columns_with_other_ends(strains: str, ends: str, factor: float) -> None:
    """Both ends pinned; clamped, with the other end guided or pinned."""
    guide = {"pinned": {"y": 0.0}, "guided": {"y": None, "angle": 0.0}, "propped": {"y": 0.0}}[ends]
    given = {k: v for k, v in guide.items() if v is not None}
    joints = {"end": {"use": "prescribed_motion", "of": "beam:right", **given}}
    if ends == "pinned":
        joints["foot"] = {"use": "revolute", "between": ["ground", "beam:left"]}
        scene = column(strains, frame="floating", reference={"chord": ["bottom_left",
                       "bottom_right"]}, joints=joints)
    else:
        scene = column(strains, joints=joints)
    found = solve(scene, "buckling", count=1)
    assert found.column("factor")[0] == pytest.approx(factor * EULER, rel=8e-3)


@pytest.mark.full
def test_a_rigid_strut_on_a_spring() -> None:
    """A vertical rigid bar, hinged at its foot with the rotational stiffness c, under its load P at
    the height l: P l = c; a weight that is not scaled takes its part of it."""
    scene = load({
        "format": 1, "bodies": {"b": {
            "use": "rigid", "mass": 2.0, "inertia": 0.1,
            "points": {"foot": [0.0, -0.5], "top": [0.0, 0.5]}, "pose": {"position": [0.0, 0.5]}}},
        "joints": {"hinge": {"use": "revolute", "between": ["ground", "b:foot"]},
                   "spring": {"use": "rotational_spring", "between": ["ground", "b:foot"],
                              "stiffness": 100.0}},
        "loads": {"push": {"use": "point_force", "on": "b:top", "force": [0.0, -10.0]},
                  "weight": {"use": "gravity", "g": [0.0, -9.81]}},
        "time": {"end": 0.1, "step": 1e-3}})
    found = solve(scene, "buckling", count=1, scaled=["push"])
    assert found.column("factor")[0] == pytest.approx((100.0 - 2.0 * 9.81 * 0.5) / 10.0, rel=1e-6)


@pytest.mark.full
def test_reduced_columns() -> None:
    full = solve(column("nonlinear"), "buckling", count=1).column("factor")[0]
    basis = {"use": "modal", "count": 6, "correction": True}
    reduced = solve(column("nonlinear", reducer={"use": "galerkin", "basis": basis}), "buckling",
                    count=1)
    assert reduced.column("factor")[0] == pytest.approx(full, rel=1e-3)


@pytest.mark.full
def test_a_column_in_tension_does_not_buckle() -> None:
    pull = {"pull": {"use": "point_force", "on": "beam:right", "force": [1.0, 0.0]}}
    found = solve(column("linear", pull), "buckling", count=2)
    assert [n.kind for n in found.notes] == ["no_buckling"] or min(found.column("factor")) > (
        100.0 * EULER)  # not in bending


@pytest.mark.full
def test_a_heated_bar_between_walls(tmp_path: Path) -> None:
    """E A alpha dT = 4 pi^2 E I / L^2, from a stored state of steady heat."""
    alpha = 1.2e-5
    air = {"air": {"use": "convection", "on": ["beam:top"], "film": 10.0, "temperature": 303.15}}
    material = {"E": E, "nu": NU, "rho": RHO, "alpha": alpha, "k": 40.0, "c": 450.0}
    walls = {"wall": {"use": "prescribed_motion", "of": "beam:right", "x": 0.0, "y": 0.0,
                      "angle": 0.0}}
    scene = column("linear", air, fields=["elastic", "thermal"], material=material,
                   joints=walls)
    solve(scene, "steady_heat", out=tmp_path / "heat")
    warm = scene.using({"initial": {"result": str(tmp_path / "heat")}})
    found = solve(warm, "buckling", count=1)
    exact = 4.0 * EULER / (E * W * H * alpha * 10.0)
    assert found.column("factor")[0] == pytest.approx(exact, rel=0.01)


@pytest.mark.full
def test_what_cannot_buckle_is_refused() -> None:
    with pytest.raises(InputError, match="no load is called"):
        solve(column("linear"), "buckling", scaled=["pusch"])
    with pytest.raises(InputError, match="moves freely"):
        solve(column("linear", frame="floating"), "buckling")
    turning = {"push": {**PUSH["push"], "axes": "body"}}
    hinge = {"foot": {"use": "revolute", "between": ["ground", "beam:left"]},
             "spring": {"use": "rotational_spring", "between": ["ground", "beam:left"],
                        "stiffness": 10.0}}
    with pytest.raises(InputError, match="not symmetric"):
        solve(column("linear", turning, frame="floating", joints=hinge), "buckling")
