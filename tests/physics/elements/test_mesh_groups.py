"""Groups of mesh files: materials, loads and temperatures act on what the file tags."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mesh_texts import Bar, abaqus, bar, gmsh, nastran
from sparsemor.bodies.fem.integrals import boundary_facets, facet_measures
from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.mesh import Mesh
from sparsemor.core.testing.in_memory_run import March, march, scene_of

LAYERS = bar(2, (0.0, 0.025, 0.05, 0.051, 0.076, 0.101), (0.05, 0.051))
"""Copper, one element of insulation, copper."""


def plate(path: Path, loads: dict[str, Any], joints: dict[str, Any], **body: Any) -> March:
    return march(scene_of({
        "bodies": {"s": {
            "use": "flexible", "frame": "fixed", "fields": ["thermal"], "thickness": 0.01,
            "reference_temperature": 300, "mesh": {"use": "file", "path": str(path)},
            "material": {"rho": 1000, "k": 0.1, "c": 1000}, **body}},
        "loads": loads, "joints": joints, "time": {"end": 1e9, "step": 1e8},
        "integrator": "bdf1"}))


def end(run: March, x: float) -> float:
    body: Any = run.model.parts["s"]
    here = body.X[body.heat.free, 0] == x
    return float(run.block("s.thermal")[-1][here].mean())


FLUX = {"q": {"use": "heat_flux", "on": ["s:HOT"], "flux": 5000.0}}
COLD = {"cold": {"use": "prescribed_temperature", "on": ["s:COLD"], "temperature": 300.0}}


@pytest.mark.parametrize("order", [1, 2])
def test_a_layer_of_one_element_keeps_its_material(order: int, tmp_path: Path) -> None:
    """300 + 5000 (0.1 / 400 + 0.001 / 0.1) = 351.25 K. All points of the insulation are points of
    copper, which made it copper: 301.26 K."""
    (tmp_path / "a.msh").write_bytes(gmsh(LAYERS))
    run = plate(tmp_path / "a.msh", FLUX, COLD, order=order,
                materials={"METAL1": {"rho": 8900, "k": 400, "c": 385}})
    assert end(run, 0.0) == pytest.approx(351.25, abs=1e-3)


@pytest.mark.parametrize(("ending", "text"), [
    ("inp", abaqus(bar())), ("msh", gmsh(bar())), ("msh", gmsh(bar(), "2.2", True))])
def test_two_metals_in_series(ending: str, text: str | bytes, tmp_path: Path) -> None:
    """400 K and 300 K at the ends, 50 and 400 W/(m K): 311.111 K in the middle."""
    file = tmp_path / f"a.{ending}"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    hot = {"hot": {"use": "prescribed_temperature", "on": ["s:HOT"], "temperature": 400.0}}
    run = plate(file, {}, {**COLD, **hot}, material={"rho": 7850, "k": 50, "c": 470},
                materials={"METAL2": {"rho": 8900, "k": 400, "c": 385}})
    assert end(run, 0.1) == pytest.approx(300 + 100 / 9, abs=1e-3)


def test_one_name_on_a_curve_and_a_surface(tmp_path: Path) -> None:
    """300 + 1e4 * 0.2 / 50 = 340 K: loads on the name act on the edges, not on the whole outline;
    materials act on the cells."""
    text = gmsh(bar()).replace(b'2 3 "METAL1"', b'2 3 "HOT"')
    (tmp_path / "a.msh").write_bytes(text)
    mesh = MeshFile(path="a.msh").build(tmp_path)
    assert len(mesh.cell_sets["HOT"]) == 10 and len(mesh.point_sets["HOT"]) == 2
    run = plate(tmp_path / "a.msh", {"q": {**FLUX["q"], "flux": 1e4}}, COLD,
                material={"rho": 7850, "k": 50, "c": 470})
    assert end(run, 0.0) == pytest.approx(340.0, abs=1e-3)


def sides(file: Path, shape: Bar, names: tuple[str, str]) -> Mesh:
    """The bar with its bottom and top, instead of an end, in the group HOT."""
    y = shape.points[:, 1]
    facets = []
    for level in (0.0, 0.02):
        on = np.isclose(y, level)
        facets += [row[on[row]] for row in shape.cells if on[row].sum() == shape.d]
    changed = Bar(shape.points, shape.cells, shape.metal,
                  {"HOT": np.array(facets), "COLD": shape.ends["COLD"]})
    text = (gmsh(changed) if file.suffix == ".msh" else abaqus(changed) if file.suffix == ".inp"
            else nastran(changed))
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    return MeshFile(path=file.name).build(file.parent)


@pytest.mark.parametrize(("name", "group", "d"), [
    ("a.msh", "HOT", 2), ("a.inp", "FACE", 2), ("a.msh", "HOT", 3), ("a.inp", "FACE", 3),
    ("a.bdf", "pid_3", 3)])
def test_facets_of_two_sides_without_those_between(
    name: str, group: str, d: int, tmp_path: Path
) -> None:
    """One element over the height: all points are in the group, the ends are not. Their facets
    had a share of 9 % of the heat: a rise of 29.814 K instead of 27.104 K."""
    mesh = sides(tmp_path / name, bar(d), ("HOT", "COLD"))
    for order in (1, 2):
        mesh = with_midpoints(mesh) if order == 2 else mesh
        facets = boundary_facets(mesh, mesh.point_sets[group], group)
        assert facet_measures(mesh, facets).sum() == pytest.approx(0.4 if d == 2 else 0.4 * 0.02)
        middle = np.isclose(mesh.points[:, 1], 0.01)  # of edges between the two sides
        assert bool(middle.any()) is (order == 2)
        assert not middle[mesh.point_sets[group]].any()


def test_facets_of_tagged_cells_are_theirs(tmp_path: Path) -> None:
    """The insulation's own outline is two edges of 1 mm; the metals' edges are not in it."""
    (tmp_path / "a.msh").write_bytes(gmsh(LAYERS))
    mesh = MeshFile(path="a.msh").build(tmp_path)
    own = boundary_facets(mesh, mesh.point_sets["METAL2"], "METAL2")
    assert facet_measures(mesh, own).sum() == pytest.approx(0.002)
    copper = boundary_facets(mesh, mesh.point_sets["METAL1"], "METAL1")
    assert facet_measures(mesh, copper).sum() == pytest.approx(0.2 + 0.04)


def test_a_material_on_edges_and_a_load_inside_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.msh").write_bytes(gmsh(LAYERS))
    with pytest.raises(InputError, match="consists of surfaces, edges or points, not of cells"):
        plate(tmp_path / "a.msh", FLUX, COLD, materials={"HOT": {"rho": 1, "k": 1, "c": 1}})
    inside = Bar(LAYERS.points, LAYERS.cells, LAYERS.metal,
                 {**LAYERS.ends, "HOT": np.array([[4, 5]])})
    (tmp_path / "b.msh").write_bytes(gmsh(inside))
    with pytest.raises(InputError, match="all 1 edges of this set lie inside the body"):
        plate(tmp_path / "b.msh", FLUX, COLD)


def test_a_load_on_facets_some_of_which_are_inside_says_so(tmp_path: Path) -> None:
    mixed = Bar(LAYERS.points, LAYERS.cells, LAYERS.metal,
                {**LAYERS.ends, "HOT": np.array([[0, 1], [4, 5]])})
    (tmp_path / "a.msh").write_bytes(gmsh(mixed))
    run = plate(tmp_path / "a.msh", FLUX, COLD)
    (text,) = noted(run, "inner_facets")
    assert "acts on 1 of the 2 edges of 's:HOT'" in text


def noted(run: March, kind: str) -> list[str]:
    return [str(n) for part in run.model.parts.values() for n in getattr(part, "notes", ())
            if n.kind == kind]


def patch(mesh: dict[str, Any], where: dict[str, Any]) -> list[str]:
    plane = {"thickness": 0.02} if mesh["use"] != "block" else {}
    run = march(scene_of({
        "bodies": {"b": {"use": "flexible", "frame": "fixed", "fields": ["thermal"], **plane,
                         "mesh": mesh, "material": {"rho": 7800, "k": 50, "c": 500},
                         "sets": {"p": where}}},
        "loads": {"q": {"use": "heat_flux", "on": ["b:p"], "flux": 1e5}},
        "time": {"end": 1.0, "step": 1.0}}))
    return noted(run, "cut_patch")


PLANE = {"use": "rectangle", "size": [1.0, 0.1], "divisions": [32, 2]}
SOLID = {"use": "block", "size": [1.0, 0.2, 0.1], "divisions": [10, 2, 1]}


@pytest.mark.parametrize(("mesh", "where", "share"), [
    (PLANE, {"box": [[0.2, 0.5], [0.099, 0.101]]}, 0.9375),
    (PLANE, {"where": "x > 0.2 and x < 0.5001 and y > 0.0999"}, 0.9375),
    (PLANE, {"box": [[0.25, 0.5], [0.099, 0.101]]}, 1.0),
    (PLANE, {"where": "x < 1e-9 or y > 0.0999"}, 1.0),
    (SOLID, {"box": [[0.0, 0.35], [0.0, 0.2], [0.1, 0.1]]}, 0.3 / 0.35),
    (SOLID, {"where": "z > 0.0999"}, 1.0),
])
def test_a_patch_that_cuts_facets_is_noted_with_its_share(
    mesh: dict[str, Any], where: dict[str, Any], share: float
) -> None:
    """0.3 m of patch on edges of 1/32 m: the load acts on 9 edges, 93.75 % of it; the facets may be
    faces, too. A patch that ends at nodes, and a side that is described with some slack, have no
    note."""
    texts = patch(mesh, where)
    assert len(texts) == (share < 1.0)
    for text in texts:
        assert float(text.split("b:p', ")[1].split("%")[0]) == pytest.approx(100 * share, abs=0.3)


def test_a_patch_on_a_circle_described_by_its_radius_is_not_cut() -> None:
    """Chords leave a thin ring between two radii, and are the surface that is meant."""
    link = {"use": "link", "length": 1.0, "height": 0.17, "bore": 0.085, "elements": 320}
    assert not patch(link, {"where": "abs(sqrt(x**2 + y**2) - 0.0425) < 1e-6"})
