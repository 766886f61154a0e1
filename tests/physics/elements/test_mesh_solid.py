"""The built-in meshes of tetrahedra: counts, sets, volumes, quality, and what makes them."""

from pathlib import Path

import numpy as np
import pytest

from sparsemor.bodies.mesh.cell_measures import signed_measures
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.bodies.mesh.generators.disk import Disk
from sparsemor.bodies.mesh.generators.extrusion import (
    extrude,
    interior_points,
    plan_mesh,
    polygon_area,
)
from sparsemor.bodies.mesh.generators.pad import Pad, pad_outline
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.protocols.mesh import Mesh


def quality(points: FloatArray, cells: IntArray) -> FloatArray:
    """1 for a regular triangle or tetrahedron, 0 for a flat one: measure over squared edges."""
    first, second = np.triu_indices(cells.shape[1], 1)
    squares = np.sum((points[cells[:, first]] - points[cells[:, second]]) ** 2, axis=(1, 2))
    size = signed_measures(points, cells)
    if cells.shape[1] == 3:
        return np.asarray(4 * np.sqrt(3) * size / squares)
    return np.asarray(12 * np.cbrt(3 * size) ** 2 / squares)


def plan(mesh: Mesh) -> tuple[FloatArray, IntArray]:
    """Points and triangles of the bottom face, seen from above."""
    faces = outer_facets(mesh)
    low = faces[np.isin(faces, mesh.point_sets["bottom"]).all(axis=1)]
    return mesh.points[mesh.point_sets["bottom"], :2], low[:, [0, 2, 1]]


# ------------------------------------------------------------------ the disk


@pytest.fixture(scope="module")
def disk() -> Mesh:
    return Disk().build(Path())


def test_disk_has_the_counts_of_the_published_scene(disk: Mesh) -> None:
    check_mesh(disk)
    assert (len(disk.cells), len(disk.points)) == (10_344, 2715)
    sizes = {name: len(points) for name, points in disk.point_sets.items()}
    assert (sizes["bottom"], sizes["top"], sizes["rim"], sizes["axis"]) == (905, 905, 3 * 84, 3)
    probes = [f"probe_{c}{a}" for c in (1, 2, 3, 4) for a in ("", "_90", "_180", "_270")]
    assert set(sizes) == {"bottom", "top", "rim", "hub", "axis", "centre", *probes}
    assert all(sizes[name] == 1 for name in ("centre", *probes))
    points, triangles = plan(disk)
    assert len(triangles) == 1724
    assert quality(points, triangles).min() > 0.7
    assert quality(disk.points, disk.cells).min() > 0.55


def test_disk_places(disk: Mesh) -> None:
    r, z = np.hypot(disk.points[:, 0], disk.points[:, 1]), disk.points[:, 2]
    sets = disk.point_sets
    np.testing.assert_allclose(r[sets["rim"]], 0.14, rtol=1e-14)
    np.testing.assert_allclose(z[sets["top"]], 0.013, rtol=1e-15)
    assert not z[sets["bottom"]].any() and not r[sets["axis"]].any()
    np.testing.assert_array_equal(sets["hub"], np.flatnonzero(r <= 0.03))
    for c, radius in enumerate((0.0867, 0.1060, 0.1188, 0.1336), 1):
        for name, way in (("", [1, 0]), ("_90", [0, 1]), ("_180", [-1, 0]), ("_270", [0, -1])):
            (at,) = disk.points[sets[f"probe_{c}{name}"]]
            np.testing.assert_allclose(at, [*(radius * np.array(way)), 0.013], atol=1e-16)
    polygon = 84 / 2 * 0.14**2 * np.sin(2 * np.pi / 84) * 0.013
    volumes = signed_measures(disk.points, disk.cells)
    assert volumes.sum() == pytest.approx(polygon, rel=1e-12)
    assert volumes.min() > 0.5 * volumes.mean()


def test_refined_disk() -> None:
    mesh = Disk(refine=0.5).build(Path())
    check_mesh(mesh)
    assert len(mesh.cells) == 1296
    assert quality(mesh.points, mesh.cells).min() > 0.4
    (at,) = mesh.points[mesh.point_sets["probe_4_90"]]
    np.testing.assert_allclose(at, [0.0, 0.1336, 0.013], atol=1e-16)


@pytest.mark.parametrize("options,key,words", [
    ({"triangles": 1725}, "triangles", "like it, even"),
    ({"triangles": 40}, "triangles", "at least 82"),
    ({"hub": 0.2}, "hub", "smaller than the radius"),
    ({"probes": (0.1, 0.1)}, "probes", "different circles"),
    ({"probes": (0.13999,)}, "probes", "inside the radius"),
    ({"rim": 82}, "rim", "multiple of 4"),
])
def test_impossible_disks_are_refused(options: dict[str, object], key: str, words: str) -> None:
    with pytest.raises(ValueError, match=rf"(?s){key}.*{words}"):
        Disk.model_validate(options)


# ------------------------------------------------------------------ the pad


@pytest.mark.full
def test_pad_outline_is_that_of_the_source() -> None:
    """Area and mean radius of the friction face: 3.5444e-3 m2 and 0.114284 m."""
    outline, corners = pad_outline(4000)
    area = polygon_area(outline)
    assert area == pytest.approx(3.5444e-3, abs=5e-8)
    points, triangles = plan_mesh(pad_outline(240)[0], 8000)
    centre = points[triangles].mean(axis=1)
    weights = signed_measures(points, triangles)
    mean = float(np.sum(weights * np.linalg.norm(centre, axis=1)) / weights.sum())
    assert mean == pytest.approx(0.114284, abs=3e-6)
    r = np.linalg.norm(outline, axis=1)
    assert (r.min(), r.max()) == (pytest.approx(0.0900, abs=5e-5), pytest.approx(0.1352, abs=5e-5))
    half_angle = np.degrees(np.arctan2(outline[:, 0], outline[:, 1]).max())
    assert half_angle == pytest.approx(20.9, abs=0.05)
    np.testing.assert_allclose(outline[[corners["top_left"], corners["top_right"]]],
                               [[-0.04, 0.105], [0.04, 0.105]], atol=1e-16)


def test_pad_has_the_counts_of_the_published_scene() -> None:
    mesh = Pad().build(Path())
    check_mesh(mesh)
    assert (len(mesh.cells), len(mesh.points)) == (900, 279)
    assert {name: len(points) for name, points in mesh.point_sets.items()} == {
        "bottom": 93, "top": 93, "side": 3 * 34,
        "top_inner": 1, "top_outer": 1, "top_left": 1, "top_right": 1}
    points, triangles = plan(mesh)
    assert len(triangles) == 150 and quality(points, triangles).min() > 0.65
    assert quality(mesh.points, mesh.cells).min() > 0.45
    np.testing.assert_allclose(
        [mesh.points[mesh.point_sets[n][0]] for n in ("top_inner", "top_outer", "top_right")],
        [[0.0, 0.09, 0.0195], [0.0, 0.135, 0.0195], [0.04, 0.105, 0.0195]], atol=1e-16)
    assert signed_measures(mesh.points, mesh.cells).sum() == pytest.approx(
        3.5444e-3 * 0.0065, rel=1e-2)
    outer = np.concatenate([mesh.point_sets[n] for n in ("bottom", "top", "side")])
    np.testing.assert_array_equal(np.unique(outer), np.unique(outer_facets(mesh)))


@pytest.mark.parametrize("refine", [0.6, 1.5])
def test_refined_pad(refine: float) -> None:
    plugin = Pad(refine=refine)
    mesh = plugin.build(Path())
    check_mesh(mesh)
    _, triangles, layers = plugin.counts()
    assert len(mesh.cells) == 3 * triangles * layers
    assert quality(mesh.points, mesh.cells).min() > 0.4


# ------------------------------------------------------------------ the block


@pytest.mark.parametrize("diagonal", ["uniform", "alternating"])
def test_block(diagonal: str) -> None:
    mesh = BlockMesh.model_validate({"lower": (-1.0, 0.0, 2.0), "size": (3.0, 1.0, 2.0),
                                 "divisions": (4, 3, 5), "diagonal": diagonal}).build(Path())
    check_mesh(mesh)
    assert (len(mesh.points), len(mesh.cells)) == (5 * 4 * 6, 6 * 60)
    volumes = signed_measures(mesh.points, mesh.cells)
    np.testing.assert_allclose(volumes, 6.0 / 360, rtol=1e-12)
    sizes = {name: len(points) for name, points in mesh.point_sets.items()}
    assert [sizes[n] for n in ("left", "right", "front", "back", "bottom", "top")] == [
        24, 24, 30, 30, 20, 20]
    (corner,) = mesh.points[mesh.point_sets["right_front_top"]]
    np.testing.assert_array_equal(corner, [2.0, 0.0, 4.0])
    assert len(sizes) == 6 + 8
    assert len(BlockMesh(size=(1, 1, 1), divisions=(2, 1, 3), refine=2).build(Path()).cells) == 288


def test_alternating_block_is_symmetric() -> None:
    """Mirrored in x, y and z it is the same set of tetrahedra; a uniform one is not."""
    def mirrored(diagonal: str, axis: int) -> bool:
        mesh = BlockMesh.model_validate(
            {"size": (2.0, 2.0, 2.0), "divisions": (2, 2, 2), "diagonal": diagonal}).build(Path())
        flipped = mesh.points.copy()
        flipped[:, axis] = 2.0 - flipped[:, axis]
        number = {tuple(p): i for i, p in enumerate(mesh.points)}
        to = np.array([number[tuple(p)] for p in flipped])
        return {tuple(sorted(c)) for c in mesh.cells} == {tuple(sorted(to[c])) for c in mesh.cells}

    assert all(mirrored("alternating", axis) for axis in range(3))
    assert not any(mirrored("uniform", axis) for axis in range(3))


# ------------------------------------------------------------------ tools


def test_extruded_layers_agree_at_their_sides() -> None:
    """Every inner face has two tetrahedra, whatever the plan's numbering."""
    rng = np.random.default_rng(0)
    angle = 2 * np.pi * np.arange(12) / 12
    points, triangles = plan_mesh(np.stack([np.cos(angle), np.sin(angle)], axis=1), 40)
    shuffle = rng.permutation(len(points))
    renumbered = np.empty_like(points)
    renumbered[shuffle] = points
    solid, cells = extrude(renumbered, shuffle[triangles], np.array([0.0, 0.1, 0.4, 0.5]))
    mesh = Mesh(solid, cells)
    check_mesh(mesh)
    assert len(cells) == 3 * 40 * 3
    assert len(outer_facets(mesh)) == 2 * 40 + 2 * 12 * 3
    assert signed_measures(solid, cells).sum() == pytest.approx(0.5 * 3.0, rel=1e-12)


def test_plan_count_is_exact_in_a_notched_outline() -> None:
    outline = []
    corners = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]], dtype=float)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        steps = round(4 * float(np.linalg.norm(b - a)))
        outline += [a + (b - a) * k / steps for k in range(steps)]
    for triangles in (160, 400):
        points, cells = plan_mesh(np.array(outline), triangles, np.array([[0.5, 0.5]]))
        assert len(cells) == triangles
        assert len(points) == len(outline) + interior_points(triangles, len(outline))
        np.testing.assert_array_equal(points[len(outline)], [0.5, 0.5])
        assert signed_measures(points, cells).sum() == pytest.approx(5.0, rel=1e-12)
        assert signed_measures(points, cells).min() > 0


def test_a_plan_without_points_inside() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    points, cells = plan_mesh(square, 2)
    assert len(points) == 4 and len(cells) == 2
    with pytest.raises(InputError, match="2 points must be nodes, but only 1"):
        plan_mesh(square, 4, np.array([[0.5, 0.5], [0.2, 0.5]]))
    with pytest.raises(InputError, match="take 4"):
        plan_mesh(square, 3)


def test_an_outline_that_the_triangles_cannot_follow_is_refused() -> None:
    """A slit as narrow as a tenth of its points' distance."""
    slit = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.05, 1.0], [1.0, 0.05], [0.95, 1.0],
                     [0.0, 1.0]])
    with pytest.raises(InputError, match="too coarse"):
        plan_mesh(slit, 15)


