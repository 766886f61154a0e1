"""Mesh files of Abaqus, Gmsh and Nastran: every order and form of a mesh is the same mesh."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from mesh_texts import abaqus, bar, canonical, gmsh, nastran
from sparsemor.bodies.fem.integrals import boundary_facets, facet_measures
from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.bodies.mesh.formats import by_meshio
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.mesh import Mesh

SEEDS = 4


def build(folder: Path, name: str, content: str | bytes) -> Mesh:
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return MeshFile(path=name).build(folder)


def expected(d: int, metals: tuple[str, str], ends: tuple[str, ...]) -> dict[str, Any]:
    """Canonical bar with the sets of its metals and, where the format tags facets, of its ends."""
    shape = bar(d)
    facets = dict(zip(ends, shape.ends.values(), strict=False))
    cells = {name: np.flatnonzero(shape.metal == m) for m, name in enumerate(metals, 1)}
    points = {n: np.unique(f) for n, f in facets.items()} | {
        n: np.unique(shape.cells[c]) for n, c in cells.items()}
    return canonical(Mesh(shape.points[:, :d], shape.cells, points, facet_sets=facets,
                          cell_sets=cells))


@pytest.mark.parametrize("d", [2, 3])
def test_abaqus_in_any_form(d: int, tmp_path: Path) -> None:
    right = expected(d, ("METAL1", "METAL2"), ("HOT", "COLD"))
    for seed in (None, *range(SEEDS)):
        rng = None if seed is None else np.random.default_rng([d, seed])
        found = canonical(build(tmp_path, f"{seed}.inp", abaqus(bar(d), rng)))
        assert found["points"] == right["points"] and found["cells"] == right["cells"]
        named: dict[str, Any] = {k: {n.upper(): v for n, v in found[k].items()}  # type: ignore[attr-defined]
                                 for k in ("point_sets", "facet_sets", "cell_sets")}
        assert named["cell_sets"] == right["cell_sets"]
        assert named["facet_sets"] == {"FACE": right["facet_sets"]["HOT"]}
        assert named["point_sets"] == {
            **right["point_sets"], "FACE": right["point_sets"]["HOT"]}
        assert {"HOT", "METAL1", "FACE"} <= set(found["point_sets"])  # type: ignore[call-overload]


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("version", ["4.1", "2.2"])
@pytest.mark.parametrize("binary", [False, True])
def test_gmsh_in_any_form(d: int, version: str, binary: bool, tmp_path: Path) -> None:
    right = expected(d, ("METAL1", "METAL2"), ("HOT", "COLD"))
    for seed in (None, *range(SEEDS)):
        rng = None if seed is None else np.random.default_rng([d, seed])
        data = gmsh(bar(d), version, binary, rng, negative=seed == 3)
        assert canonical(build(tmp_path, f"{seed}.msh", data)) == right


@pytest.mark.parametrize("d", [2, 3])
def test_nastran_in_any_form(d: int, tmp_path: Path) -> None:
    right = expected(d, ("pid_1", "pid_2"), ("pid_3", "pid_4") if d == 3 else ())
    for seed in (None, *range(SEEDS)):
        rng = None if seed is None else np.random.default_rng([d, seed])
        text = nastran(bar(d), rng, head=seed != 2)
        assert canonical(build(tmp_path, f"{seed}.bdf", text)) == right


def bent(kind: str) -> tuple[str, np.ndarray]:  # type: ignore[type-arg]
    """A cylindrical or spherical system about (-0.1, -0.1, 0.05), its z axis along (0, 1, 1), and
    the bar's points in it."""
    X = bar(3).points - np.array([-0.1, -0.1, 0.05])
    z = np.array([0.0, 1.0, 1.0]) / np.sqrt(2)
    x = np.array([1.0, 0.0, 0.0])
    u, v, w = X @ x, X @ np.cross(z, x), X @ z
    card = (f"CORD2{kind},7,,-0.1,-0.1,0.05,-0.1,0.9,1.05\n,0.9,-0.1,0.05")
    if kind == "R":
        return card, np.column_stack([u, v, w])
    phi = np.degrees(np.arctan2(v, u))
    if kind == "C":
        return card, np.column_stack([np.hypot(u, v), phi, w])
    r = np.sqrt(u**2 + v**2 + w**2)
    return card, np.column_stack([r, np.degrees(np.arccos(w / r)), phi])


@pytest.mark.parametrize("kind", ["R", "C", "S"])
def test_nastran_coordinate_systems(kind: str, tmp_path: Path) -> None:
    """Points written in a moved and turned system are where they are in the basic one."""
    right = expected(3, ("pid_1", "pid_2"), ("pid_3", "pid_4"))
    card, coordinates = bent(kind)
    text = nastran(bar(3), np.random.default_rng(1), system=7, cards=card, coordinates=coordinates)
    assert canonical(build(tmp_path, "a.bdf", text)) == right
    with pytest.raises(InputError, match=r"a.bdf:\d+: GRID: there is no coordinate system 7"):
        build(tmp_path, "a.bdf", text.replace(card, "$"))


def test_systems_by_grids_and_by_other_systems(tmp_path: Path) -> None:
    """CORD1R through three grids, and CORD2R in it: a triangle turned by 90 degrees twice."""
    text = ("GRID,1,,1.,0.,0.\nGRID,2,,1.,0.,1.\nGRID,3,,1.,1.,0.\n"  # x axis along y
            "CORD1R,5,1,2,3\nCORD2R,6,5,0.,0.,0.,0.,0.,1.\n,0.,1.,0.\n"  # its x along -x
            "GRID,4,6,0.,0.,0.\nGRID,5,6,2.,0.,0.\nGRID,6,6,0.,3.,0.\nCTRIA3,1,1,4,5,6\n")
    mesh = build(tmp_path, "a.bdf", text)
    np.testing.assert_allclose(mesh.points, [[1, 0], [-1, 0], [1, -3]], atol=1e-12)
    with pytest.raises(InputError, match=r"a.bdf:5: CORD2R: .*refers to itself"):
        build(tmp_path, "a.bdf", text.replace("CORD2R,6,5", "CORD2R,6,6"))


REFUSED: dict[str, tuple[Callable[[str], str], str]] = {
    "include": (lambda t: t.replace("*NSET", "*INCLUDE, INPUT=more.inp\n*NSET", 1),
                r"\*INCLUDE: paste"),
    "generated nodes": (lambda t: t.replace("*NSET", "*NGEN\n1,2\n*NSET", 1), r"\*NGEN: "),
    "unknown type": (lambda t: t.replace("CPS3", "CPS3X9", 1), r"\*ELEMENT: TYPE=CPS3X9"),
    "axisymmetric": (lambda t: t.replace("CPS3", "CAX3", 1), r"\*ELEMENT: .*axisymmetric"),
    "short row": (lambda t: t.replace("1, 5, 25, 35", "1, 5, 25"),
                  r"\*ELEMENT: element 1 has 2 nodes, and CPS3 takes 3"),
    "no such node": (lambda t: t.replace("*NSET, NSET=HOT\n", "*NSET, NSET=HOT\n7, "),
                     r"\*NSET: there is no node 7"),
    "no such set": (lambda t: t.replace("*NSET, NSET=HOT\n", "*NSET, NSET=HOT\nLOST, "),
                    r"\*NSET: there is no set of nodes 'LOST'"),
    "set of itself": (lambda t: t.replace("*NSET, NSET=HOT\n", "*NSET, NSET=HOT\nHOT, "),
                      r"\*NSET: the set HOT contains itself"),
    "face": (lambda t: t.replace("2, S3", "2, S4"), r"\*SURFACE: face 'S4'"),
    "word for a number": (lambda t: t.replace("15, 0.0", "15, O.O", 1), r"\*NODE: 'O.O'"),
    "node twice": (lambda t: t.replace("*NSET", "*NODE\n15, 1., 1., 0.\n*NSET", 1),
                   r"\*NODE: there is a node 15 already"),
    "element twice": (lambda t: t.replace("*NSET", "*ELEMENT, TYPE=CPS3\n1, 5, 15, 25\n*NSET", 1),
                      r"\*ELEMENT: there is an element 1 already"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_abaqus_is_refused_with_line_and_keyword(name: str, tmp_path: Path) -> None:
    change, message = REFUSED[name]
    plain = abaqus(bar())
    changed = change(plain)
    assert changed != plain
    with pytest.raises(InputError, match=r"a.inp:\d+: " + message) as caught:
        build(tmp_path, "a.inp", changed)
    line = int(caught.value.faults[0].message.split(":")[1])
    first = next(n for n, (a, b) in enumerate(
        zip(plain.split("\n"), changed.split("\n"), strict=False), 1) if a != b)
    assert first - 2 <= line <= first + 2


def in_a_part(text: str, instances: str) -> str:
    """The file with its mesh in a part BAR, sets included, and the given instances."""
    head, mesh = text.split("*NODE", 1)
    mesh, tail = mesh.split("*MATERIAL", 1)
    return (f"{head}*PART, NAME=BAR\n*NODE{mesh}*END PART\n*ASSEMBLY, NAME=A\n{instances}"
            f"*END ASSEMBLY\n*MATERIAL{tail}")


def test_an_instance_is_placed_and_named(tmp_path: Path) -> None:
    """Translation (0.3, 0, 0), then a quarter turn about z through (1, 1): x -> 2 - y, y -> x."""
    text = in_a_part(abaqus(bar()), "*INSTANCE, NAME=Bar-1, PART=bar\n0.3, 0., 0.\n"
                     "1., 1., 0., 1., 1., 1., 90.\n*END INSTANCE\n"
                     "*NSET, NSET=ROOT, INSTANCE=Bar-1\n5, 15\n*NSET, NSET=TIP\nBar-1.COLD\n"
                     "*NSET, NSET=ONE\nBAR-1.5,\n"
                     "*SURFACE, NAME=ALL\nBar-1.METAL1,\nBar-1.METAL2,\n")
    mesh = build(tmp_path, "a.inp", text)
    x, y = bar().points[:, 0] + 0.3, bar().points[:, 1]
    np.testing.assert_allclose(mesh.points, np.column_stack([2.0 - y, x]), atol=1e-12)
    sets = {n: m.tolist() for n, m in mesh.point_sets.items()}
    assert sets["ROOT"] == sets["HOT"] == sets["BAR-1.HOT"] == sets["Bar-1.HOT"] == [0, 1]
    assert sets["TIP"] == sets["COLD"] == [20, 21] and sets["ONE"] == [0]
    assert len(mesh.cell_sets["Bar-1"]) == 20 and len(mesh.cell_sets["METAL2"]) == 10
    assert len(mesh.facet_sets["ALL"]) == 22  # the free edges: all but those between cells


def test_two_instances_are_refused_at_the_second(tmp_path: Path) -> None:
    text = in_a_part(abaqus(bar()), "*INSTANCE, NAME=B1, PART=BAR\n*END INSTANCE\n"
                     "*INSTANCE, NAME=B2, PART=BAR\n0., 1., 0.\n*END INSTANCE\n")
    line = text.split("\n").index("*INSTANCE, NAME=B2, PART=BAR") + 1
    with pytest.raises(InputError, match=rf"a.inp:{line}: \*INSTANCE: B2 shares no nodes with B1"):
        build(tmp_path, "a.inp", text)


def test_names_of_the_assembly_come_before_those_of_parts(tmp_path: Path) -> None:
    """Abaqus/CAE numbers sets of parts and of the assembly alike: Set-1, Set-2."""
    text = in_a_part(abaqus(bar()), "*INSTANCE, NAME=B1, PART=BAR\n*END INSTANCE\n"
                     "*NSET, NSET=HOT, INSTANCE=B1\n205, 215\n")
    sets = build(tmp_path, "a.inp", text).point_sets
    assert sets["HOT"].tolist() == [20, 21] and sets["B1.HOT"].tolist() == [0, 1]


def test_what_is_not_read_is_in_a_note(tmp_path: Path) -> None:
    mesh = build(tmp_path, "a.inp", abaqus(bar()) + "*NSET, NSET=SOME, GENERATE\n5, 45, 1\n")
    texts = [str(note) for note in mesh.notes]
    assert texts[0] == "a.inp: only the mesh is read, not *MATERIAL, *ELASTIC"
    assert texts[1].endswith("*NSET: 36 of the nodes in this range do not exist")
    assert len(mesh.point_sets["SOME"]) == 5
    notes = build(tmp_path, "a.bdf", nastran(bar(3))).notes
    assert [str(n) for n in notes] == [
        "a.bdf: only the mesh is read, not MAT1",
        "a.bdf: 4 elements of lower dimension name points, edges and faces, and are no part of the "
        "body: 4 (108: CTRIA3)"]
    assert not build(tmp_path, "a.msh", gmsh(bar())).notes


@pytest.mark.parametrize("version", ["4.1", "2.2"])
def test_one_name_for_two_tags(version: str, tmp_path: Path) -> None:
    text = gmsh(bar(), version).decode().replace("METAL2", "METAL1")
    assert len(build(tmp_path, "a.msh", text).cell_sets["METAL1"]) == 20
    if version == "4.1":  # an entity in two groups of one name
        text = text.replace("2 0.0 0.0 0.0 1.0 1.0 1.0 1 2 0", "2 0.0 0.0 0.0 1.0 1.0 1.0 2 2 1 0")
        text = text.replace('1 2 "COLD"', '1 2 "HOT"')
        assert len(build(tmp_path, "a.msh", text).facet_sets["HOT"]) == 2


def test_duplicates_of_format_2_2_are_one_element_in_two_groups(tmp_path: Path) -> None:
    """Gmsh writes an element of two physical groups twice, reversed if the group has the surface
    with a minus sign."""
    text = gmsh(bar(), "2.2").decode()
    body = text.split("$Elements\n")[1].split("\n\n$End")[0].split("\n")
    cells = [line.split() for line in body[1:] if line.split()[1] == "2"]
    more = [" ".join([str(100 + i), "2", "2", "-9", w[4], *w[:4:-1]]) for i, w in enumerate(cells)]
    both = [str(len(body) - 1 + len(more)), *body[1:], *more]
    mesh = build(tmp_path, "a.msh", text.replace("\n".join(body), "\n".join(both)))
    assert len(mesh.cells) == 20 and len(mesh.cell_sets["surface_9"]) == 20
    assert len(mesh.cell_sets["METAL1"]) == 10


BAD_GMSH: dict[str, tuple[str, str, str]] = {
    "partitioned": ("$Entities", "$PartitionedEntities\n1\n$EndPartitionedEntities\n$Entities",
                    r"a.msh:11: \$PartitionedEntities: "),
    "old": ("4.1 0 8", "4 0 8", r"a.msh:2: \$MeshFormat: version 4 is not supported"),
    "count": ("4 22 1 22", "4 23 1 23", r"\$Elements: 23 elements were announced, 22 are here"),
    "no node": ("21 25 27 28", "21 25 27 99", r"\$Elements: there is no node 99"),
    "no entity": ("2 4 2 10", "2 5 2 10", r"\$Elements: there is no entity 5 of dimension 2"),
    "order 3": ("2 4 2 10", "2 4 21 10", r"\$Elements: elements of type 21 are not supported"),
    "word": ("0.02 0.0 0.0", "0.02 O.0 0.0", r"a.msh:\d+: \$Nodes: 'O.0' is no number"),
    "no end": ("$EndElements", "", r"\$Elements: has no \$EndElements"),
}


@pytest.mark.parametrize("name", BAD_GMSH)
def test_gmsh_is_refused_with_line_and_section(name: str, tmp_path: Path) -> None:
    before, after, message = BAD_GMSH[name]
    text = gmsh(bar()).decode()
    assert before in text
    with pytest.raises(InputError, match=message):
        build(tmp_path, "a.msh", text.replace(before, after, 1))


BAD_NASTRAN: dict[str, tuple[str, str, str]] = {
    "include": ("GRID", "INCLUDE 'more.bdf'\nGRID", "INCLUDE: paste"),
    "word": ("     .02", "     .O2", "GRID: field 5 is '.O2', and no number"),
    "no grid": ("       1       3       5       6", "       1       3       5      99",
                "CTRIA3: there is no grid 99"),
    "short": ("       1       3       5       6", "       1       3       5", "element 1 has 2"),
    "twice": ("CTRIA3         1", "GRID,3,,9.,9.,9.\nCTRIA3         1",
              "there is a grid 3 already"),
    "second part": ("ENDDATA", "BEGIN SUPER=1\nENDDATA", "BEGIN: a second part"),
    "axisymmetric": ("CTRIA3 ", "CTRIAX6", "CTRIAX6: axisymmetric"),
    "nine grids": ("CTRIA3 ", "CQUAD9 ", "CQUAD9: this type of elements is not supported"),
}


@pytest.mark.parametrize("name", BAD_NASTRAN)
def test_nastran_is_refused_with_line_and_card(name: str, tmp_path: Path) -> None:
    before, after, message = BAD_NASTRAN[name]
    text = nastran(bar()).replace("    0.02", "     .02")
    assert before in text
    with pytest.raises(InputError, match=r"a.bdf:\d+: .*" + message):
        build(tmp_path, "a.bdf", text.replace(before, after, 1))


def test_complete_cells_of_gmsh_have_no_place_in_other_formats(tmp_path: Path) -> None:
    ids = ", ".join(str(i) for i in range(1, 19))
    with pytest.raises(InputError, match="18 nodes, and C3D6 takes 6 .*SecondOrderIncomplete"):
        build(tmp_path, "a.inp", f"*NODE\n1, 0, 0, 0\n*ELEMENT, TYPE=C3D6\n1, {ids}\n")
    lines = ["CPENTA,1,1,1,2,3,4,5,6", ",7,8,9,10,11,12,13,14", ",15,16,17,18"]
    with pytest.raises(InputError, match="18 grids, and takes 6 or 15 .*SecondOrderIncomplete"):
        build(tmp_path, "a.bdf", "BEGIN BULK\n" + "\n".join(lines) + "\nENDDATA\n")


def test_a_count_that_differs_from_the_lines_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A reader that drops a cell, or shifts a set, is found by a plain count of the lines."""
    from sparsemor.bodies.mesh import mesh_file as module
    from sparsemor.bodies.mesh.formats.file_content import CellBlock, Content

    def without_last(read: Callable[[bytes, str], Content]) -> Callable[[bytes, str], Content]:
        def reader(data: bytes, name: str) -> Content:
            found = read(data, name)
            blocks = [CellBlock(b.kind, b.nodes[:-1] if i == 0 else b.nodes) for i, b in
                      enumerate(found.blocks)]
            return Content(found.points, blocks, {})
        return reader

    for kind, ending, text in (("abaqus", "inp", abaqus(bar())), ("gmsh", "msh", gmsh(bar())),
                               ("gmsh", "msh", gmsh(bar(), "2.2")),
                               ("nastran", "bdf", nastran(bar(3)))):
        build(tmp_path, f"a.{ending}", text)
        with monkeypatch.context() as patch:
            patch.setitem(module.OWN, kind, without_last(module.OWN[kind]))
            with pytest.raises(InputError, match="were read, and a plain count of its lines finds"):
                build(tmp_path, f"a.{ending}", text)
    shape = bar()
    for ending, options in (("vtk", {"binary": False, "file_format": "vtk"}),
                            ("vtk", {"binary": False, "file_format": "vtk42"}),
                            ("vtu", {"binary": False}), ("mesh", {})):
        meshio.Mesh(shape.points, [("triangle", shape.cells)]).write(
            tmp_path / f"a.{ending}", **options)
        MeshFile(path=f"a.{ending}").build(tmp_path)
        with monkeypatch.context() as patch:
            patch.setattr(module.by_meshio, "read", without_last(module.by_meshio.read))
            with pytest.raises(InputError, match="19 cells of type triangle were read, .* 20"):
                MeshFile(path=f"a.{ending}").build(tmp_path)


def test_a_set_of_other_elements_than_its_lines_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """meshio gave the elements of the block before to a set, where that had no ELSET."""
    from sparsemor.bodies.mesh import mesh_file as module
    from sparsemor.bodies.mesh.formats.file_content import Content, MeshGroup

    def shifted(read: Callable[[bytes, str], Content]) -> Callable[[bytes, str], Content]:
        def reader(data: bytes, name: str) -> Content:
            found = read(data, name)
            groups = {n: MeshGroup(g.points, g.facets, [(b, rows[1:]) for b, rows in g.cells])
                      for n, g in found.groups.items()}
            return Content(found.points, found.blocks, groups)
        return reader

    for kind, ending, text in (("abaqus", "inp", abaqus(bar())), ("gmsh", "msh", gmsh(bar())),
                               ("gmsh", "msh", gmsh(bar(), "2.2")),
                               ("nastran", "bdf", nastran(bar(3)))):
        monkeypatch.setitem(module.OWN, kind, shifted(module.OWN[kind]))
        with pytest.raises(InputError, match="cells of type .* in '.*' were read, and a plain"):
            build(tmp_path, f"a.{ending}", text)


def test_a_set_of_nodes_and_of_elements_with_one_name(tmp_path: Path) -> None:
    """Abaqus/CAE writes a face as its nodes and the elements behind it, a region as all its nodes
    and elements: as a surface, both are the outline of the elements between the nodes."""
    text = abaqus(bar())
    text += "*NSET, NSET=TOP, GENERATE\n15, 215, 20\n*ELSET, ELSET=TOP, GENERATE\n2, 20, 2\n"
    text += "*NSET, NSET=END\n5, 15, 25, 35\n*ELSET, ELSET=END\n1, 2\n"
    mesh = build(tmp_path, "a.inp", text)
    sizes = {n: facet_measures(mesh, boundary_facets(mesh, mesh.point_sets[n], n)).sum()
             for n in ("TOP", "END")}
    assert sizes == pytest.approx({"TOP": 0.2, "END": 0.06})
    assert len(mesh.cell_sets["TOP"]) == 10


def test_midpoints_of_a_set_of_cells_are_theirs(tmp_path: Path) -> None:
    """All points of the layer between them are of the other metal; its edges' midpoints are not."""
    layers = bar(2, (0.0, 0.05, 0.051, 0.101), (0.05, 0.051))
    mesh = with_midpoints(build(tmp_path, "a.msh", gmsh(layers)))
    own = mesh.points[mesh.point_sets["METAL1"]]
    assert len(own) == 18 and not np.any((own[:, 0] > 0.0501) & (own[:, 0] < 0.0509))


@pytest.mark.parametrize(("name", "text"), [
    ("a.inp", "*NODE\n1,0.,0.,0.\n*NSET, NSET=A, GENERATE\n1, 1000000000000000, 1\n"),
    ("a.inp", "*NSET, NSET=A0\n" + "".join(
        f"*NSET, NSET=A{i}\n" + f"A{i - 1}, " * 9 + "\n" for i in range(1, 400))),
    ("a.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 900000000000 1 1\n2 1 0 "
     "900000000000\n$EndNodes\n"),
    ("a.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Elements\n900000000000\n1 2 2 0 0 1 2 3\n"
     "$EndElements\n"),
    ("a.bdf", "GRID,1,,1+99999,0.,0.\n" + "CTRIA3,1,1,1,1,1\n"),
    ("a.bdf", "".join(f"CORD2R,{i},{i + 1},0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n" for i in range(
        1, 2000)) + "GRID,1,1\n"),
])
def test_numbers_that_ask_for_much_are_refused_in_one_line(
    name: str, text: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        build(tmp_path, name, text)
    assert "\n" not in str(caught.value) and str(tmp_path) not in str(caught.value)


def test_edges_of_quadratic_triangles(tmp_path: Path) -> None:
    """The midpoint is the second of the three nodes of T3D3, and the last of Gmsh's."""
    text = ("*NODE\n1,0.,0.,0.\n2,1.,0.,0.\n3,0.,1.,0.\n4,.5,0.,0.\n5,.5,.5,0.\n6,0.,.5,0.\n"
            "*ELEMENT, TYPE=CPS6, ELSET=ALL\n1, 1,2,3,4,5,6\n"
            "*ELEMENT, TYPE=T3D3, ELSET=SIDE\n2, 1,4,2\n")
    mesh = build(tmp_path, "a.inp", text)
    assert mesh.facet_sets["SIDE"].tolist() == [[0, 1]]
    assert mesh.point_sets["SIDE"].tolist() == [0, 1, 3]


def test_groups_without_elements_are_named(tmp_path: Path) -> None:
    text = gmsh(bar(), "2.2").decode()
    head, elements = text.split("$Elements\n22\n")
    rows = [line.split() for line in elements.split("\n\n$End")[0].split("\n")]
    without = "\n".join(" ".join([*w[:3], "0", *w[4:]]) for w in rows)
    mesh = build(tmp_path, "a.msh", f"{head}$Elements\n22\n{without}\n$EndElements\n")
    assert not mesh.point_sets
    assert [str(n) for n in mesh.notes] == [
        "a.msh: no element of the file is in the groups HOT, COLD, METAL1, METAL2 (Mesh.SaveAll of "
        "this format drops them: save it as 4.1)"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_names_in_other_letters_with_blanks_and_signs(encoding: str, tmp_path: Path) -> None:
    names = ["Zylinder außen", "part  in 'A'", 'métal "2" \\', "HOT side"]
    gmsh_text = gmsh(bar()).decode()
    for old, new in zip(("METAL1", "METAL2", "HOT", "COLD"), names, strict=True):
        gmsh_text = gmsh_text.replace(f'"{old}"', f'"{new}"')
    if encoding != "utf-8-sig":
        mesh = build(tmp_path, "a.msh", gmsh_text.encode(encoding))
        assert sorted(mesh.point_sets) == sorted(names)
    text = abaqus(bar()).replace("ELSET=METAL1", "ELSET=außen").replace(
        "ELSET=METAL2", 'ELSET="part, in  A"').replace("NSET=HOT", "NSET = Bord chauffé ")
    mesh = build(tmp_path, "a.inp", text.encode(encoding))
    assert {"außen", "part, in  A", "Bord chauffé", "COLD"} <= set(mesh.point_sets)
    assert len(mesh.cell_sets["part, in  A"]) == 10


def test_groups_of_medit_and_salome(tmp_path: Path) -> None:
    """References of a Medit file, and families of a Salome file as meshio gives them, which needs
    h5py to read one."""
    shape = bar()
    cells = [("line", shape.ends["HOT"]), ("triangle", shape.cells)]
    meshio.Mesh(shape.points, cells, cell_data={
        "medit:ref": [np.full(1, 5), shape.metal]}).write(tmp_path / "a.mesh")
    mesh = MeshFile(path="a.mesh").build(tmp_path)
    assert {n: len(c) for n, c in mesh.cell_sets.items()} == {"surface_1": 10, "surface_2": 10}
    assert mesh.facet_sets["curve_5"].tolist() == [[0, 1]]
    ends = np.where(shape.points[:, 0] == 0.2, 4, 0)
    salome = meshio.Mesh(shape.points, cells, point_data={"point_tags": ends}, cell_data={
        "cell_tags": [np.array([-1]), -shape.metal - 1]})
    salome.cell_tags = {-1: ["hot"], -2: ["left", "all"], -3: ["right", "all"]}
    salome.point_tags = {4: ["tip"]}
    groups = by_meshio.content_of(salome).groups
    found = {n: [(b, len(r)) for b, r in g.cells] for n, g in groups.items()}
    assert found == {"hot": [(0, 1)], "left": [(1, 10)], "right": [(1, 10)],
                     "all": [(1, 10), (1, 10)], "tip": []}
    assert groups["tip"].points[0].tolist() == [20, 21]
