"""The built-in meshes: counts, sets, quality and soundness."""

from pathlib import Path

import numpy as np
import pytest

from sparsemor.bodies.mesh.cell_measures import signed_measures
from sparsemor.bodies.mesh.generators.link import Link
from sparsemor.bodies.mesh.generators.rectangle import Rectangle
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.protocols.mesh import Mesh


def quality(mesh: Mesh) -> FloatArray:
    """4 sqrt(3) A / sum of squared edges: 1 for an equilateral triangle."""
    corners = mesh.points[mesh.cells]
    squares = np.sum((corners - np.roll(corners, 1, axis=1)) ** 2, axis=(1, 2))
    return np.asarray(4 * np.sqrt(3) * signed_measures(mesh.points, mesh.cells) / squares)


def test_rectangle() -> None:
    mesh = Rectangle(lower=(-1.0, 2.0), size=(3.0, 1.0), divisions=(6, 4)).build(Path())
    check_mesh(mesh)
    assert (len(mesh.points), len(mesh.cells)) == (35, 48)
    assert signed_measures(mesh.points, mesh.cells).sum() == pytest.approx(3.0)
    assert {name: len(points) for name, points in mesh.point_sets.items()} == {
        "left": 5, "right": 5, "bottom": 7, "top": 7,
        "bottom_left": 1, "bottom_right": 1, "top_left": 1, "top_right": 1,
    }
    np.testing.assert_array_equal(mesh.points[mesh.point_sets["top_right"]], [[2.0, 3.0]])
    assert np.all(mesh.points[mesh.point_sets["left"], 0] == -1.0)


def test_alternating_rectangle_is_symmetric() -> None:
    mesh = Rectangle(size=(4.0, 2.0), divisions=(4, 2), diagonal="alternating").build(Path())
    check_mesh(mesh)
    centres = mesh.points[mesh.cells].mean(axis=1)
    mirrored = np.array([4.0, 2.0]) - centres
    mirrored[:, 1] = centres[:, 1]
    distance = np.linalg.norm(centres[:, None] - mirrored[None], axis=2).min(axis=1)
    assert distance.max() < 1e-12


@pytest.mark.parametrize("r,points,top", [(1, 735, 57), (2, 2751, 113), (3, 6047, 169)])
def test_link_counts(r: int, points: int, top: int) -> None:
    mesh = Link(elements=1280 * r * r).build(Path())
    check_mesh(mesh)
    assert (len(mesh.points), len(mesh.cells)) == (points, 1280 * r * r)
    sizes = {name: len(members) for name, members in mesh.point_sets.items()}
    assert sizes == {
        "bore_a": 32 * r, "bore_b": 32 * r, "top": top, "bottom": top,
        "left": 8 * r + 1, "right": 8 * r + 1, "chord_a": 1, "chord_b": 1,
    }
    for members in mesh.point_sets.values():
        assert np.all(np.diff(members) > 0)
    assert quality(mesh).min() > 0.6


def test_coarse_link() -> None:
    mesh = Link(elements=320).build(Path())
    check_mesh(mesh)
    sizes = {name: len(members) for name, members in mesh.point_sets.items()}
    assert (len(mesh.points), len(mesh.cells), sizes["bore_a"], sizes["top"]) == (203, 320, 16, 25)
    assert quality(mesh).min() > 0.6


def test_link_places() -> None:
    mesh = Link().build(Path())
    sets = mesh.point_sets
    assert quality(mesh).min() == pytest.approx(0.65, abs=5e-3)
    np.testing.assert_allclose(mesh.points[sets["chord_a"]], [[0.0425, 0.0]], atol=1e-15)
    np.testing.assert_allclose(mesh.points[sets["chord_b"]], [[0.9575, 0.0]], atol=1e-15)
    for name, x in (("bore_a", 0.0), ("bore_b", 1.0)):
        around = mesh.points[sets[name]] - [x, 0.0]
        np.testing.assert_allclose(np.linalg.norm(around, axis=1), 0.0425, rtol=1e-12)
        np.testing.assert_allclose(around.mean(axis=0), 0.0, atol=1e-15)
    np.testing.assert_allclose(mesh.points.min(axis=0), [-0.085, -0.085], atol=1e-15)
    np.testing.assert_allclose(mesh.points.max(axis=0), [1.085, 0.085], atol=1e-15)
    outline = np.concatenate([sets[n] for n in ("top", "bottom", "left", "right", "bore_a",
                                                "bore_b")])
    np.testing.assert_array_equal(np.unique(outline), np.unique(outer_facets(mesh)))


def test_link_of_other_proportions() -> None:
    mesh = Link(length=0.5, height=0.2, bore=0.05).build(Path())
    check_mesh(mesh)
    polygon = 16 * 0.025**2 * np.sin(2 * np.pi / 32)
    area = 0.7 * 0.2 - 2 * polygon
    assert signed_measures(mesh.points, mesh.cells).sum() == pytest.approx(area, rel=1e-12)
