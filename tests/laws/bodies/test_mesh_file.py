"""Mesh files: groups become sets, and a file that cannot be used says why."""

from pathlib import Path
from resource import RLIMIT_AS, getrlimit
from typing import Any

import meshio
import numpy as np
import pytest

from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh
from sparsemor.bodies.mesh.mesh_file import MeshFile
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


def written(folder: Path, name: str, points: Any, cells: list[Any], **more: Any) -> MeshFile:
    known = {"file_format": "gmsh22"} if name.endswith(".msh") else {}
    meshio.Mesh(np.asarray(points, dtype=float), cells, **more).write(folder / name, **known)
    return MeshFile(path=name)


def flat(points: Any) -> FloatArray:
    plane = np.asarray(points, dtype=np.float64)
    return np.column_stack([plane, np.zeros(len(plane))])


GMSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
1 7 "lower edge"
2 8 "sheet"
$EndPhysicalNames
$Entities
0 1 1 0
1 0 0 0 1 0 0 1 7 0
1 0 0 0 1 1 0 1 8 1 1
$EndEntities
$Nodes
1 4 1 4
2 1 0 4
1
2
3
4
0 0 0
1 0 0
1 1 0
0 1 0
$EndNodes
$Elements
2 3 1 3
1 1 1 1
1 1 2
2 1 2 2
2 1 2 3
3 1 3 4
$EndElements
"""


def test_tetrahedra_and_scale(tmp_path: Path) -> None:
    corners = [[0, 0, 0], [1000, 0, 0], [0, 1000, 0], [0, 0, 1000]]
    plugin = written(tmp_path, "tet.vtk", corners, [("triangle", [[0, 1, 2]]),
                                                    ("tetra", [[0, 1, 2, 3]])])
    built = plugin.model_copy(update={"scale": 1e-3}).build(tmp_path)
    assert (built.dimension, built.cells.tolist()) == (3, [[0, 1, 2, 3]])
    np.testing.assert_allclose(built.points[1], [1.0, 0.0, 0.0])


def test_mesh_inverted_throughout_is_turned(tmp_path: Path) -> None:
    plugin = written(tmp_path, "turned.vtk", flat(SQUARE), [("triangle", HALVES[:, ::-1])])
    check_mesh(plugin.build(tmp_path))


def test_cells_in_either_orientation_are_turned(tmp_path: Path) -> None:
    """Mesh generators write each surface in an orientation of its own."""
    plugin = written(tmp_path, "mixed.vtk", flat(SQUARE), [("triangle", [[0, 1, 2], [0, 3, 2]])])
    np.testing.assert_array_equal(plugin.build(tmp_path).cells, HALVES)


FILES: dict[str, tuple[Any, list[Any], str]] = {
    "folded": (flat([[0, 0], [1, 0], [1, 1], [0.9, 0.2]]), [("triangle", HALVES)],
               "1 of 2 cells are inverted and overlap"),
    "pyramid": ([*flat(SQUARE), [0.5, 0.5, 1.0]], [("pyramid", [[0, 1, 2, 3, 4]])],
                "highest cells are pyramid"),
    "pyramid beside a tetrahedron": (
        [*flat(SQUARE), [0.5, 0.5, 1.0], [2, 0, 0]],
        [("pyramid", [[0, 1, 2, 3, 4]]), ("tetra", [[1, 5, 2, 4]])],
        "highest cells are pyramid, tetra",
    ),
    "lines": (flat(SQUARE), [("line", [[0, 1]])], "highest cells are line"),
    "shell": (
        [[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]], [("triangle", HALVES)], "z = constant"
    ),
    "outside": (flat(SQUARE), [("triangle", [[0, 1, 9]])], "name points that do not exist"),
    "pieces": (
        flat([*SQUARE, *(SQUARE + 3)]), [("triangle", [*HALVES, *(HALVES + 4)])], "2 pieces"
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_unusable_files(tmp_path: Path, name: str) -> None:
    points, cells, words = FILES[name]
    plugin = written(tmp_path, "bad.vtk", points, cells)
    with pytest.raises(InputError, match=f"bad.vtk: .*{words}") as caught:
        plugin.build(tmp_path)
    assert caught.value.faults[0].key == "path"
    assert str(tmp_path) not in str(caught.value)


@pytest.mark.parametrize("name", ["bad.msh", "bad.vtk", "bad.inp", "bad.xyz", "bad"])
def test_unreadable_files_neither_print_nor_leave(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text("this is not a mesh\n")
    with pytest.raises(InputError, match=name) as caught:
        MeshFile(path=name).build(tmp_path)
    assert caught.value.faults[0].key == "path"
    assert str(tmp_path) not in str(caught.value)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["bad.msh", "bad.vtk", "bad.inp"])
def test_a_long_path_is_not_in_the_message(tmp_path: Path, name: str) -> None:
    """Beyond 80 characters meshio's own print wraps the path, so that no one recognised it."""
    folder = tmp_path / "a folder with a name of some length" / "and one more of them in it"
    folder.mkdir(parents=True)
    (folder / name).write_text("this is not a mesh\n")
    with pytest.raises(InputError, match="cannot be read as|bad.*:1: ") as caught:
        MeshFile(path=name).build(folder)
    text = "".join(str(caught.value).split())
    assert len(str(folder)) > 80 and "oneofthem" not in text and "ofsomelength" not in text


@pytest.mark.parametrize("ending", ["ele", "wkt", "mdpa", "ply", "dat", "xyz", "stl", "e"])
def test_formats_that_cannot_be_bounded_are_refused_by_name(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"m.{ending}").write_text("1 2 3\n")
    with pytest.raises(InputError, match="none of the supported formats.*msh, .inp, .vtk"):
        MeshFile(path=f"m.{ending}").build(tmp_path)


def refused(folder: Path, name: str, content: str | bytes) -> str:
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(InputError) as caught:
        MeshFile(path=name).build(folder)
    assert caught.value.faults[0].key == "path"
    return caught.value.faults[0].message


NO_CELLS = "*NODE\n1, 0., 0., 0.\n*ELEMENT, TYPE=CPS3\n"


def test_files_without_cells_or_coordinates_are_refused(tmp_path: Path) -> None:
    assert "no cells" in refused(tmp_path, "a.inp", NO_CELLS)
    rigid_copy = "*NODE\n*ELEMENT, TYPE=CPS3\n1, 1, 2, 3\n"
    assert "b.inp:2: *ELEMENT: there is no node 1" in refused(tmp_path, "b.inp", rigid_copy)
    assert "cannot be read as medit" in refused(
        tmp_path, "c.mesh", "MeshVersionFormatted 2\nDimension 1\nVertices\n1\n0 1\nEnd\n")


def test_a_number_that_asks_for_all_memory_is_refused(tmp_path: Path) -> None:
    """A point number of 1e9 took 8 GB; a count of 2e8 in a binary file took 8 GB and 30 s."""
    assert "there is no node 4" in refused(
        tmp_path, "tag.msh", GMSH.replace("1\n2\n3\n4\n0 0 0", "1\n2\n3\n900000000\n0 0 0"))
    assert "ends before the 200000000 nodes" in refused(
        tmp_path, "count.msh", b"$MeshFormat\n2.2 1 8\n\x01\0\0\0\n$EndMeshFormat\n$Nodes\n"
        b"200000000\n" + bytes(200) + b"\n$EndNodes\n")


def test_the_bound_on_memory_ends_with_the_reading(tmp_path: Path) -> None:
    before = getrlimit(RLIMIT_AS)
    (tmp_path / "sheet.msh").write_text(GMSH)
    MeshFile(path="sheet.msh").build(tmp_path)
    refused(tmp_path, "bad.msh", "not a mesh")
    assert getrlimit(RLIMIT_AS) == before


def test_missing_file_is_named_as_given(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file 'meshes/link.msh'") as caught:
        MeshFile(path="meshes/link.msh").build(tmp_path)
    assert caught.value.faults[0].key == "path"
    assert str(tmp_path) not in str(caught.value)
