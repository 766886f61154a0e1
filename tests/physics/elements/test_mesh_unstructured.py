"""Unstructured rectangles: the exact count, good triangles, the same ones each time."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from sparsemor.bodies.mesh.cell_measures import signed_measures
from sparsemor.bodies.mesh.generators.unstructured import Unstructured, quality
from sparsemor.bodies.mesh.mesh_checks_and_repairs import check_mesh
from sparsemor.core.errors import InputError
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.protocols.mesh import Mesh
from sparsemor.core.testing.mesh import check_mesh_plugin
from tiers import full

SLIDER: dict[str, Any] = {"size": (1.25e-3, 1.25e-3), "divisions": (24, 24), "elements": 1336}
PLATE: dict[str, Any] = {"size": (5.0e-3, 1.25e-3), "divisions": (72, 18), "elements": 2034}


def built(**options: Any) -> Mesh:
    return Unstructured(**options).build(Path())


@pytest.mark.parametrize("options,points,area", [
    full(SLIDER, 717, 1.25e-3**2), full(PLATE | {"seed": 6}, 1108, 5.0e-3 * 1.25e-3),
    ({"size": (1, 1), "divisions": (1, 1), "elements": 2}, 4, 1.0),
    ({"size": (2, 1), "divisions": (4, 2), "elements": 12}, 13, 2.0),
    full({"size": (1, 1), "divisions": (24, 24), "elements": 800}, 449, 1.0),
])
def test_exact_counts(options: dict[str, Any], points: int, area: float) -> None:
    mesh = built(**options)
    check_mesh(mesh)
    assert (len(mesh.points), len(mesh.cells)) == (points, options["elements"])
    assert signed_measures(mesh.points, mesh.cells).sum() == pytest.approx(area, rel=1e-12)
    assert quality(mesh.points, mesh.cells).min() > 0.6


@pytest.mark.full
def test_the_outline_is_as_asked() -> None:
    """Also that no boundary segment is skipped: the sides' points are all there is outside."""
    mesh = built(**PLATE | {"lower": (1.0e-3, -1.25e-3)})
    sets = {name: mesh.points[members] for name, members in mesh.point_sets.items()}
    sizes = {name: len(points) for name, points in sets.items()}
    corners = {f"{v}_{h}": 1 for v in ("bottom", "top") for h in ("left", "right")}
    assert sizes == {"left": 19, "right": 19, "bottom": 73, "top": 73, "top_center": 1, **corners}
    np.testing.assert_allclose(sets["top_center"], [[3.5e-3, 0.0]], atol=1e-15)
    np.testing.assert_allclose(sets["bottom_right"], [[6.0e-3, -1.25e-3]], atol=1e-15)
    x = np.sort(sets["top"][:, 0])
    np.testing.assert_allclose(np.diff(x), 5.0e-3 / 72, rtol=1e-9)
    sides = np.concatenate([mesh.point_sets[n] for n in ("left", "right", "bottom", "top")])
    facets = outer_facets(mesh)
    np.testing.assert_array_equal(np.unique(facets), np.unique(sides))
    assert len(facets) == 180


@pytest.mark.full
def test_refinement_splits_each_triangle_in_four() -> None:
    coarse, fine = built(**SLIDER), built(**SLIDER | {"refine": 2})
    check_mesh(fine)
    assert len(fine.cells) == 16 * 1336 and len(fine.point_sets["bottom"]) == 97
    assert quality(fine.points, fine.cells).min() == pytest.approx(
        quality(coarse.points, coarse.cells).min(), rel=1e-9)
    assert len(fine.point_sets["top_center"]) == 1


def test_an_odd_number_of_segments_has_no_node_in_the_middle() -> None:
    options: dict[str, Any] = {"size": (3, 2), "divisions": (3, 2), "elements": 14}
    assert "top_center" not in built(**options).point_sets
    assert "top_center" in built(**options, refine=1).point_sets


@pytest.mark.full
def test_the_same_mesh_each_time_and_another_for_another_seed() -> None:
    check_mesh_plugin(Unstructured(**SLIDER))
    one, other = built(**SLIDER), built(**SLIDER | {"seed": 1})
    assert not np.array_equal(one.points, other.points)


def test_no_preferred_direction() -> None:
    """Edges lie evenly between 0 and 180 degrees: a structured mesh has three directions."""
    mesh = built(**SLIDER)
    edges = mesh.points[mesh.cells] - mesh.points[np.roll(mesh.cells, 1, axis=1)]
    angles = np.degrees(np.arctan2(edges[..., 1], edges[..., 0])) % 180.0
    share = np.histogram(angles, bins=12, range=(0.0, 180.0))[0] / angles.size
    assert share.min() > 0.04 and share.max() < 0.16


@pytest.mark.parametrize("options,words", [
    ({"elements": 1337}, "their number is even; take 1338"),
    ({"elements": 92}, "the outline of 96 segments alone needs 94"),
    ({"divisions": (0, 24)}, "greater than or equal to 1"),
    ({"size": (0.0, 1.0)}, "greater than 0"),
    ({"refine": -1}, "greater than or equal to 0"),
])
def test_counts_that_cannot_be(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Unstructured(**SLIDER | options)


@pytest.mark.full
@pytest.mark.parametrize("options,words", [
    ({"elements": 20000}, "these divisions take about 1330 triangles"),
    ({"elements": 94}, "these divisions take about 1330 triangles"),
    ({"size": (1.0, 1.0e-14)}, "some would be flat"),
])
def test_flat_triangles_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        built(**SLIDER | options)
    assert caught.value.faults[0].key == "elements"
