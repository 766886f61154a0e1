"""Analyses against CalculiX on one mesh of second-order tetrahedra, whose shape functions, and with
them the matrices, are the same in both codes: numbers agree to the digits that CalculiX prints."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import skfem
from scipy.sparse.linalg import eigsh
from skfem.helpers import dot, grad
from skfem.models.elasticity import lame_parameters, linear_elasticity

import calculix
from sparsemor import Scene, load, solve
from sparsemor.core.arrays import FloatArray

pytestmark = pytest.mark.full
ccx = pytest.mark.skipif(not calculix.PRESENT, reason="CalculiX (ccx) is not installed")

E, NU, RHO = 2.1e11, 0.3, 7800.0
HEADER = "*INCLUDE, INPUT=mesh.inp\n"
CARDS = HEADER + calculix.material(E, NU, RHO) + "*BOUNDARY\nroot, 1, 3\n"
L, B, H = 0.3, 0.12, 0.01
SETS = {"root": "x < 1e-9", "tip": f"x > {L} - 1e-9", "top": f"z > {H / 2} - 1e-9"}


@pytest.fixture
def slab(tmp_path: Path) -> calculix.Solid:
    """A cantilever plate of 384 tetrahedra in `tmp_path`."""
    made = calculix.block((0.0, -B / 2, -H / 2), (L, B, H), (8, 4, 2), SETS)
    made.write(tmp_path / "mesh.inp")
    return made


def scene(folder: Path, loads: Any, fields: str = "elastic", **options: Any) -> Scene:
    """The body of `mesh.inp` in a fixed frame."""
    held = {"reference": {"clamp": "root"}} if fields == "elastic" else {}
    return load({
        "format": 1, "time": {"end": 1.0, "step": 0.5},
        "bodies": {"b": {"use": "flexible", "mesh": {"use": "file", "path": str(
            folder / "mesh.inp")}, "fields": [fields], "material": {"E": E, "nu": NU, "rho": RHO},
            "frame": "fixed", **held, **options}},
        "loads": loads, "probes": {"tip": {"body": "b", "at": "tip"}}})


def apart(got: FloatArray, want: FloatArray) -> float:
    """Largest difference relative to the largest value."""
    return float(np.abs(got - want).max() / np.abs(want).max())


def displacements(found: Any) -> FloatArray:
    return np.asarray(found.result.nodal_displacement("b", 0))


@ccx
def test_displacement_and_stress_under_pressure(slab: calculix.Solid, tmp_path: Path) -> None:
    lines = calculix.by_ccx(tmp_path, CARDS + f"""*STEP
*STATIC
*DLOAD
{slab.on_faces('top', 'P#, 1e4')}
*NODE PRINT, NSET=NALL
U
*EL FILE
S
*END STEP
""")
    found = solve(scene(tmp_path, {"p": {"use": "pressure", "on": ["b:top"], "pressure": 1e4}}),
                  "static")
    assert found.result is not None
    assert apart(displacements(found), calculix.table(lines, "displacements")[:, 1:]) < 1e-6
    S = found.result.stress("b", 0)
    six = np.stack([S[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))], 1)
    assert apart(six, calculix.nodal(tmp_path, "STRESS")) < 1e-5


def quadratic(plate: calculix.Solid, intorder: int, vector: bool = True) -> skfem.Basis:
    n = plate.nodes[:, :4].max() + 1
    scalar = skfem.ElementTetP2()
    return skfem.Basis(skfem.MeshTet(plate.X[:n].T, plate.nodes[:, :4].T),
                       skfem.ElementVector(scalar) if vector else scalar, intorder=intorder)


def frequencies_with_four_points(slab: calculix.Solid) -> FloatArray:
    """Hz, with the mass matrix by the rule of 4 points, as of CalculiX, in place of the exact
    one."""
    basis = quadratic(slab, 2)
    K = linear_elasticity(*lame_parameters(E, NU)).assemble(basis)
    M = RHO * skfem.BilinearForm(lambda u, v, _: dot(u, v)).assemble(basis)
    free = np.setdiff1d(np.arange(K.shape[0]), basis.get_dofs(lambda x: x[0] < 1e-9).all())
    values = eigsh(K[free][:, free].tocsc(), 8, M[free][:, free].tocsc(), sigma=0.0,
                   return_eigenvectors=False)
    return np.asarray(np.sqrt(np.sort(values)) / (2.0 * np.pi))


@ccx
@pytest.mark.parametrize("strains", ["linear", "nonlinear"])
def test_frequencies(slab: calculix.Solid, tmp_path: Path, strains: str) -> None:
    """CalculiX integrates the mass matrix of C3D10 at 4 points, which is not exact."""
    lines = calculix.by_ccx(tmp_path, CARDS + "*STEP\n*FREQUENCY\n8\n*END STEP\n")
    want = calculix.table(lines, "MODE NO")[:, 3]
    found = solve(scene(tmp_path, {}, strains=strains), "frequencies", count=8)
    np.testing.assert_allclose(found.column("frequency_hz"), want, rtol=2e-3)
    np.testing.assert_allclose(frequencies_with_four_points(slab), want, rtol=1e-6)


@ccx
def test_large_deflection(slab: calculix.Solid, tmp_path: Path) -> None:
    """Weight that bends the plate by eight times its thickness: both codes take Green-Lagrange
    strains and second Piola-Kirchhoff stress."""
    g = 2e4
    lines = calculix.by_ccx(tmp_path, CARDS + f"""*STEP, NLGEOM
*STATIC
1., 1.
*DLOAD
EALL, GRAV, {g}, 0., 0., -1.
*NODE PRINT, NSET=NALL
U
*END STEP
""")
    weight = {"w": {"use": "gravity", "g": [0.0, 0.0, -g]}}
    want = calculix.table(lines, "displacements", -1)[:, 1:]
    found = displacements(solve(scene(tmp_path, weight, strains="nonlinear"), "static"))
    assert np.abs(want).max() > 7.0 * H
    assert apart(found, want) < 1e-5
    linear = displacements(solve(scene(tmp_path, weight), "static"))
    assert apart(linear, want) > 0.1


@ccx
def test_frequency_response(slab: calculix.Solid, tmp_path: Path) -> None:
    """Through the first resonance at 96 Hz. CalculiX superposes modes, 40 of them here."""
    alpha, beta = 20.0, 1e-6
    lines = calculix.by_ccx(tmp_path, CARDS + f"""*STEP
*FREQUENCY, STORAGE=YES
40
*END STEP
*STEP
*STEADY STATE DYNAMICS
50., 300., 6, 1.
*MODAL DAMPING, RAYLEIGH
,, {alpha}, {beta}
*DLOAD
{slab.on_faces('top', 'P#, 1e4')}
*NODE PRINT, NSET=tip
U
*END STEP
""")
    at = slab.X[slab.sets["tip"]][:, 1:]
    corner = int(np.argmin(np.linalg.norm(at - [B / 2, H / 2], axis=1)))
    heads = [line for line in lines if "displacements" in line]
    assert len(heads) > 10
    theirs = [calculix.table(lines, "displacements", i)[corner, 3] for i in range(len(heads))]
    f = [float(line.split()[-1]) for line in heads[::2]]
    want = np.array(theirs[::2]) + 1j * np.array(theirs[1::2])
    loaded = scene(tmp_path, {"p": {"use": "pressure", "on": ["b:top"], "pressure": {
        "use": "ramp", "end": 1.0, "final": 1e4}}}, damping={"mass": alpha, "stiffness": beta})
    loaded = loaded.using({"probes.tip.at": [L, B / 2, H / 2]})
    found = solve(loaded, "frequency_response", input="loads.p.pressure", frequencies=f,
                  outputs=["tip.u_z"], at=0.0)
    got = 1e4 * np.array(found.column("tip.u_z")) * np.exp(
        1j * np.radians(found.column("tip.u_z phase_deg")))
    assert np.abs(want).max() > 10.0 * np.abs(want).min()
    assert float((np.abs(got - want) / np.abs(want)).max()) < 1e-3


@ccx
def test_steady_heat(slab: calculix.Solid, tmp_path: Path) -> None:
    """A flux at the tip, a film on top, a temperature at the root. CalculiX integrates the film
    at 3 points of each face, which is not exact."""
    lines = calculix.by_ccx(tmp_path, HEADER + """*MATERIAL, NAME=M
*CONDUCTIVITY
45.
*SOLID SECTION, ELSET=EALL, MATERIAL=M
*INITIAL CONDITIONS, TYPE=TEMPERATURE
NALL, 300.
*BOUNDARY
root, 11, 11, 320.
*STEP
*HEAT TRANSFER, STEADY STATE
*DFLUX
""" + slab.on_faces("tip", "S#, 5e4") + "\n*FILM\n" + slab.on_faces("top", "F#, 290., 60.") + """
*NODE PRINT, NSET=NALL
NT
*END STEP
""")
    heated = scene(tmp_path, {
        "in": {"use": "heat_flux", "on": ["b:tip"], "flux": 5e4},
        "out": {"use": "convection", "on": ["b:top"], "film": 60.0, "temperature": 290.0}},
        "thermal", material={"rho": RHO, "k": 45.0, "c": 460.0}, initial_temperature=300.0)
    heated = heated.using({"joints": {"hold": {
        "use": "prescribed_temperature", "on": ["b:root"], "temperature": 320.0}}})
    found = solve(heated, "steady_heat")
    assert found.result is not None
    want = calculix.table(lines, "temperatures")[:, 1]
    assert np.ptp(want) > 25.0
    np.testing.assert_allclose(found.result.nodal_temperature("b", 0), want, atol=0.02)
    three = temperatures_with_three_points(slab)
    np.testing.assert_allclose(three, want[:len(three)], atol=2e-4)


def temperatures_with_three_points(slab: calculix.Solid) -> FloatArray:
    """K at the corners, with the film matrix by the rule of 3 points, as of CalculiX."""
    basis = quadratic(slab, 2, vector=False)
    side = {name: skfem.FacetBasis(basis.mesh, basis.elem, facets=basis.mesh.facets_satisfying(
        rule), intorder=2) for name, rule in (
            ("top", lambda x: x[2] > H / 2 - 1e-9), ("tip", lambda x: x[0] > L - 1e-9))}
    value = skfem.LinearForm(lambda v, _: v)
    A = (45.0 * skfem.BilinearForm(lambda u, v, _: dot(grad(u), grad(v))).assemble(basis)
         + 60.0 * skfem.BilinearForm(lambda u, v, _: u * v).assemble(side["top"]))
    f = 60.0 * 290.0 * value.assemble(side["top"]) + 5e4 * value.assemble(side["tip"])
    root = basis.get_dofs(lambda x: x[0] < 1e-9).all()
    T = skfem.solve(*skfem.condense(A, f, x=np.full(basis.N, 320.0), D=root))
    return np.asarray(T[basis.nodal_dofs[0]])


SIDE, THICK = 0.4, 0.008
EULER = 4.0 * np.pi**2 * E * THICK**3 / 12.0 / (1.0 - NU**2) / SIDE**2
"""k pi^2 D / b^2 of a square plate on simple supports that is pressed along one direction, N/m."""


def pressed_plate(folder: Path) -> tuple[calculix.Solid, Scene]:
    """Square plate whose middle plane does not move across it along the rim."""
    rim = f"(abs(z) < 1e-9) & ((abs(x) > {SIDE / 2} - 1e-9) | (abs(y) > {SIDE / 2} - 1e-9))"
    plate = calculix.block((-SIDE / 2, -SIDE / 2, -THICK / 2), (SIDE, SIDE, THICK), (12, 12, 2), {
        "rim": rim, "left": f"x < {-SIDE / 2} + 1e-9", "right": f"x > {SIDE / 2} - 1e-9",
        "middle": "abs(x) + abs(y) + abs(z) < 1e-9",
        "line": f"abs(y) + abs(z) + abs(x - {SIDE / 2}) < 1e-9"})
    plate.write(folder / "mesh.inp")
    loads = {name: {"use": "pressure", "on": [f"b:{name}"], "pressure": 1.0 / THICK}
             for name in ("left", "right")}
    return plate, scene(folder, loads, reference={
        "hold": {"rim": "z", "middle": "xy", "line": "y"}}).using({"probes": {}})


def test_buckling_of_a_plate(tmp_path: Path) -> None:
    _, pressed = pressed_plate(tmp_path)
    (factor,) = solve(pressed, "buckling", count=1).column("factor")
    # shear across the plate takes about (pi h / b)^2 / (5 (1 - nu)) 2 = 0.2 %
    assert factor == pytest.approx(EULER, rel=0.01)


@ccx
def test_buckling_of_a_plate_by_both_codes(tmp_path: Path) -> None:
    plate, pressed = pressed_plate(tmp_path)
    P = 1e5 / THICK  # factors far from 1 lose digits there
    lines = calculix.by_ccx(tmp_path, HEADER + calculix.material(E, NU, RHO) + f"""*BOUNDARY
rim, 3, 3
middle, 1, 2
line, 2, 2
*STEP
*BUCKLE
4, 1e-9
*DLOAD
{plate.on_faces('left', f'P#, {P}')}
{plate.on_faces('right', f'P#, {P}')}
*END STEP
""")
    found = solve(pressed, "buckling", count=4)
    want = calculix.table(lines, "MODE NO")[:, 1]
    np.testing.assert_allclose(found.column("factor"), 1e5 * want, rtol=1e-5)
