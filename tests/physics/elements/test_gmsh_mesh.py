"""Meshes of geometry files by Gmsh: mass and bores of the geometry, sets by rules, bad input."""

import json
import sys
from pathlib import Path
from subprocess import run
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from typer.testing import CliRunner

from sparsemor.bodies.fem.integrals import scalar_mass
from sparsemor.bodies.mesh.cad_geometry_by_gmsh import FaceRule, GmshMesh
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.bodies.mesh.set_centres import centre_of_set
from sparsemor.core.cli import app
from sparsemor.core.errors import InputError
from sparsemor.core.testing import check_mesh_plugin


def plate(folder: Path) -> float:
    """Writes plate.step, 60 x 40 x 10 mm with bores of radius 8, 4 and 4 mm; its volume, m^3."""
    gmsh = pytest.importorskip("gmsh", exc_type=(ImportError, OSError))  # type: ignore[arg-type]
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        whole = occ.addBox(0, 0, 0, 60, 40, 10)
        bores = [(3, occ.addCylinder(x, y, -1, 0, 0, 12, r))
                 for x, y, r in ((20, 20, 8), (45, 10, 4), (45, 30, 4))]
        occ.cut([(3, whole)], bores)
        occ.synchronize()
        gmsh.write(str(folder / "plate.step"))
        gmsh.write(str(folder / "plate.igs"))
    finally:
        gmsh.finalize()
    return (0.06 * 0.04 - np.pi * (0.008**2 + 2 * 0.004**2)) * 0.01


@pytest.mark.full
def test_a_plate_of_a_step_file(tmp_path: Path) -> None:
    volume = plate(tmp_path)
    rules: dict[str, Any] = {
        "large": {"cylinder": 1}, "small": {"radius": 0.004, "nearest": [0.045, 0.03, 0.0]},
        "top": {"nearest": [0.03, 0.003, 0.01]}}
    plugin = GmshMesh(geometry="plate.step", size=0.008, faces={
        name: FaceRule(**rule) for name, rule in rules.items()})
    mesh = plugin.build(tmp_path)
    check_mesh_plugin(plugin, tmp_path)
    assert mesh.order == 2
    assert scalar_mass(mesh, 1.0).sum() == pytest.approx(volume, rel=1e-4)
    for name, where in (("large", [0.02, 0.02]), ("small", [0.045, 0.03])):
        found = centre_of_set(mesh, mesh.point_sets[name], name=name).point
        np.testing.assert_allclose(found, [*where, 0.005], atol=1e-9)
    assert np.allclose(mesh.points[mesh.point_sets["top"], 2], 0.01)
    several = plugin.model_copy(update={"faces": {"small": FaceRule(cylinder=2)}})
    with pytest.raises(InputError, match="2 cylinders have this radius") as refused:
        several.build(tmp_path)
    assert refused.value.faults[0].key == "faces.small"
    missing = plugin.model_copy(update={"faces": {"bore": FaceRule(radius=0.005)}})
    with pytest.raises(InputError, match="radii: 0.008, 0.004, 0.004 m"):
        missing.build(tmp_path)
    (tmp_path / "bad.step").write_text("no geometry")
    with pytest.raises(InputError, match="Gmsh cannot mesh 'bad.step'") as refused:
        GmshMesh(geometry="bad.step", size=0.01).build(tmp_path)
    assert refused.value.faults[0].key == "geometry"


CONROD = Path(__file__).parents[3] / "docs" / "examples" / "conrod.step"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Meshes of a connecting rod in tetrahedra of first (rod1) and second order (rod2) and of a
    block in hexahedra (block), as Gmsh writes them with all elements and millimetres."""
    gmsh = pytest.importorskip("gmsh", exc_type=(ImportError, OSError))  # type: ignore[arg-type]
    folder = tmp_path_factory.mktemp("written")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # Open Cascade keeps that of before
        gmsh.merge(str(CONROD))
        gmsh.option.setNumber("Mesh.MeshSizeMax", 7.0)
        gmsh.model.mesh.generate(3)
        for order in (1, 2):
            gmsh.model.mesh.setOrder(order)
            for ending in ("msh", "inp", "vtk", "bdf"):
                gmsh.write(str(folder / f"rod{order}.{ending}"))
        gmsh.clear()
        base = gmsh.model.occ.addRectangle(0, 0, 0, 60, 20)
        gmsh.model.occ.extrude([(2, base)], 0, 0, 10, numElements=[4], recombine=True)
        gmsh.model.occ.synchronize()
        for _, curve in gmsh.model.getBoundary([(2, base)], oriented=False):
            gmsh.model.mesh.setTransfiniteCurve(curve, 7)
        gmsh.model.mesh.setTransfiniteSurface(base)
        gmsh.model.mesh.setRecombine(2, base)
        gmsh.model.mesh.generate(3)
        for ending in ("msh", "inp", "vtk", "bdf"):
            gmsh.write(str(folder / f"block.{ending}"))
    finally:
        gmsh.finalize()
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["msh", "inp", "vtk", "bdf"])
@pytest.mark.parametrize(("name", "volume", "error"), [
    ("rod1", 67264.942, 4e-3), ("rod2", 67264.942, 1e-4), ("block", 12000.0, 1e-12)])
def test_what_gmsh_writes_is_accepted(
    written: Path, name: str, volume: float, error: float, ending: str
) -> None:
    """Mass of the geometry (conrod_step.py); chords of arcs in tetrahedra of first order miss the
    bores and the round ends."""
    mesh = MeshFile(path=f"{name}.{ending}", scale=1e-3).build(written)
    assert mesh.dimension == 3
    assert scalar_mass(mesh, 1.0).sum() == pytest.approx(1e-9 * volume, rel=error)
    if name == "rod2":  # nodes of the bore, with those in the middle of its edges
        r = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
        near = r < 0.0232
        assert near.sum() > 100 and np.abs(r[near] - 0.022).max() < 2e-5
    scene = {"format": 1, "time": {"end": 1e-3, "step": 1e-3}, "bodies": {"part": {
        "use": "flexible", "fields": ["elastic"], "material": {"E": 2e11, "nu": 0.3, "rho": 7850},
        "mesh": {"use": "file", "path": f"{name}.{ending}", "scale": 1e-3},
        "sets": {"end": {"where": "x < 5e-3"}}, "reference": {"clamp": "end"}}}}
    (written / "scene.yaml").write_text(json.dumps(scene))
    done = CliRunner().invoke(app, ["validate", str(written / "scene.yaml")])
    assert done.exit_code == 0, done.output


@pytest.mark.full
def test_faces_of_an_iges_file_are_sewn(tmp_path: Path) -> None:
    """In metres, in a process that has read no STEP file before."""
    volume = plate(tmp_path)
    code = ("from pathlib import Path\nfrom sparsemor.bodies.fem.integrals import scalar_mass\n"
            "from sparsemor.bodies.mesh.cad_geometry_by_gmsh import GmshMesh\n"
            f"m = GmshMesh(geometry='plate.igs', size=0.008).build(Path({str(tmp_path)!r}))\n"
            "print(m.dimension, scalar_mass(m, 1.0).sum())")
    found = run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    d, mass = found.stdout.split()[-2:]
    assert d == "3" and float(mass) == pytest.approx(volume, rel=2e-4)


@pytest.mark.full
def test_a_script_in_mm_without_scale_and_a_name_twice(tmp_path: Path) -> None:
    pytest.importorskip("gmsh", exc_type=(ImportError, OSError))  # type: ignore[arg-type]
    (tmp_path / "a.geo").write_text('SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 40, 20, 10};\n'
                                    'Physical Surface("end") = {1};\n')
    with pytest.raises(InputError, match=r"has 8e\+03 m3: some 1e\+12 cells .* `scale: 1.0e-3`"):
        GmshMesh(geometry="a.geo", size=4e-3).build(tmp_path)
    with pytest.raises(InputError, match="has a group 'end' already"):
        GmshMesh(geometry="a.geo", size=0.01, scale=1e-3, faces={
            "end": FaceRule(nearest=(0.0, 0.0, 0.0))}).build(tmp_path)


@pytest.mark.full
def test_a_script_with_a_physical_curve(tmp_path: Path) -> None:
    pytest.importorskip("gmsh", exc_type=(ImportError, OSError))  # type: ignore[arg-type]
    (tmp_path / "disk.geo").write_text(
        'SetFactory("OpenCASCADE");\nDisk(1) = {1, 2, 0, 3};\nPhysical Surface("whole") = {1};\n'
        'Physical Curve("rim") = {1};\n')
    mesh = GmshMesh(geometry="disk.geo", size=1.0e-3, scale=1.0e-3).build(tmp_path)
    assert mesh.dimension == 2 and set(mesh.point_sets) == {"whole", "rim"}
    assert scalar_mass(mesh, 1.0).sum() == pytest.approx(np.pi * 9e-6, rel=1e-4)
    found = centre_of_set(mesh, mesh.point_sets["rim"], name="rim").point
    np.testing.assert_allclose(found, [1e-3, 2e-3], atol=1e-12)


@pytest.mark.parametrize(("options", "words"), [
    ({"geometry": "rod.msh"}, "its name must end in .step"),
    ({"geometry": "rod.step"}, "there is no file"),
    ({"geometry": "unit.step", "scale": 1e-3}, "have their unit")])
def test_bad_input(options: dict[str, Any], words: str, tmp_path: Path) -> None:
    (tmp_path / "unit.step").touch()
    with pytest.raises(InputError, match=words):
        GmshMesh(size=1e-3, **options).build(tmp_path)
    for rule in ({}, {"cylinder": 1, "radius": 2.0}):
        with pytest.raises(ValidationError, match="takes `cylinder` or `radius`"):
            FaceRule(**rule)  # type: ignore[arg-type]
