"""What can be wrong with a mesh, a set or a material is named, with its place."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from sparsemor.bodies.mesh.generators.link import Link
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh
from sparsemor.bodies.mesh.point_sets import PointSet, find_set, with_sets
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.mesh import Mesh

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


def mesh(points: object = SQUARE, cells: object = HALVES) -> Mesh:
    return Mesh(np.asarray(points, dtype=np.float64), np.asarray(cells, dtype=np.int64))


def plate() -> Mesh:
    return Rectangle(size=(1.0, 0.1), divisions=(10, 2)).build(Path())


# --------------------------------------------------------------------------- sets


def test_declared_sets() -> None:
    found = with_sets(plate(), {
        "corner": PointSet(box=[(0.9, 1.0), (0.05, 0.1)]),
        "upper": PointSet(where="y > 0.08 and x < 0.35"),
        "probe": PointSet(nearest=[0.52, 0.06]),
    })
    np.testing.assert_allclose(
        found.points[found.point_sets["corner"]], [[0.9, 0.05], [0.9, 0.1], [1, 0.05], [1, 0.1]]
    )
    assert len(found.point_sets["upper"]) == 4
    np.testing.assert_allclose(found.points[found.point_sets["probe"]], [[0.5, 0.05]])
    assert "top" in found.point_sets


def test_all_faults_of_sets_come_at_once() -> None:
    with pytest.raises(InputError) as caught:
        with_sets(plate(), {
            "top": PointSet(where="y > 0.08"),
            "far": PointSet(box=[(5.0, 6.0), (0.0, 1.0)]),
            "flat": PointSet(nearest=[0.0, 0.0, 0.0]),
            "high": PointSet(where="z > 0"),
        })
    faults = {f.key: f.message for f in caught.value.faults}
    assert set(faults) == {"top", "far", "flat.nearest", "high.where"}
    assert "already" in faults["top"]
    assert "[0, 1] x [0, 0.1] m" in faults["far"]
    assert "3 coordinates given for a 2-D mesh" in faults["flat.nearest"]


@pytest.mark.parametrize(
    "options,words",
    [
        ({}, "nothing given"),
        ({"where": "x > 0", "nearest": [0, 0]}, "where and nearest given"),
        ({"box": [[1, 0], [0, 1]]}, "each pair is \\[lower, upper\\]"),
        ({"where": "x + 1"}, "give a condition"),
        ({"circle": 1.0}, "Extra inputs"),
    ],
)
def test_set_declarations_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        PointSet.model_validate(options)


def test_unknown_set_names_the_near_one_first() -> None:
    words = "no set 'botom': did you mean bottom"
    with pytest.raises(InputError, match=words):
        find_set(plate(), "botom", "loads.flux.on")
    with pytest.raises(InputError, match="declare it under `sets`") as caught:
        find_set(mesh(), "top", "loads.flux.on")
    assert caught.value.faults[0].key == "loads.flux.on"
    np.testing.assert_array_equal(find_set(plate(), "left", ""), [0, 1, 2])


# --------------------------------------------------------------------------- checks


FAULTY = {
    "inverted": (mesh(cells=[[0, 1, 2], [0, 3, 2]]), "1 of 2 cells are inverted .*: 1; "),
    "degenerate": (
        mesh([[0, 0], [1, 0], [1, 1], [0.5, 0]], [[0, 1, 2], [0, 3, 1]]), "1 of 2 cells are deg"
    ),
    "duplicate": (mesh(cells=[[0, 1, 2], [0, 2, 3], [1, 2, 0]]), "1 of 3 cells are duplicates"),
    "pieces": (
        mesh([*SQUARE, *(SQUARE + [3, 0])], [*HALVES, *(HALVES + 4)]), "2 pieces share no edge"
    ),
    "hinge": (
        mesh([[0, 0], [1, 0], [0, 1], [-1, 0], [0, -1]], [[0, 1, 2], [0, 3, 4]]),
        "2 pieces share no edge; the smallest has 1 cells",
    ),
    "unused": (mesh([*SQUARE, [5, 5]]), "1 of 5 points are in no cell: 4; the first is at \\(5, 5"),
    "crowded": (
        mesh([*SQUARE, [0.2, 0.9]], [*HALVES, [0, 2, 4]]), "1 edges belong to more than two cells"
    ),
    "outside": (mesh(cells=[[0, 1, 7]]), "name points outside 0..3: 0"),
    "not finite": (mesh([[0, 0], [1, 0], [np.nan, 1], [0, 1]]), "1 points are not finite: 2"),
    "empty": (mesh(cells=np.zeros((0, 3))), "there are no cells"),
    "wrong shape": (mesh(cells=[[0, 1, 2, 3, 0]]), "do not make a mesh"),
    "folded quad": (mesh(cells=[[0, 1, 3, 2]]), "1 of 1 cells are folded over"),
}


@pytest.mark.parametrize("name", FAULTY)
def test_faulty_meshes(name: str) -> None:
    faulty, words = FAULTY[name]
    with pytest.raises(InputError, match=words):
        check_mesh(faulty)


def test_sound_mesh_passes_and_several_faults_come_at_once() -> None:
    check_mesh(mesh())
    with pytest.raises(InputError) as caught:
        check_mesh(mesh([*SQUARE, [5, 5]], [[0, 1, 2], [0, 3, 2]]))
    assert len(caught.value.faults) == 2


# --------------------------------------------------------------------------- generators


@pytest.mark.parametrize(
    "elements,nearest",
    [(1, 320), (700, 320), (900, 1280), (1281, 1280), (5000, 5120), (20000, 20480)]
)
def test_link_elements(elements: int, nearest: int) -> None:
    with pytest.raises(ValidationError, match=f"take {nearest}"):
        Link(elements=elements)


def test_link_must_fit() -> None:
    with pytest.raises(ValidationError, match="the bore must be smaller than the height"):
        Link(bore=0.2)


@pytest.mark.parametrize(
    "options", [{"size": [1, 0]}, {"divisions": [0, 1]}, {"diagonal": "crossed"}, {"radius": 1}]
)
def test_rectangle_options(options: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        Rectangle.model_validate({"size": [1, 1], "divisions": [1, 1]} | options)
