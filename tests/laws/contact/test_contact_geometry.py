"""Geometry of contact: cells, parts of facets, nearest facets; and the kit of its laws."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.clipping import Parts
from sparsemor.bodies.contact.closest_points import closest_points, nearest
from sparsemor.bodies.contact.contact_laws import Coulomb, ElasticFoundation
from sparsemor.bodies.contact.overlaps import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.quadrature import rule
from sparsemor.bodies.contact.surface import Planes, area_slopes, cells_of
from sparsemor.bodies.fem.integrals import area_vectors
from sparsemor.bodies.mesh.generators.block import BlockMesh
from sparsemor.core.model.facets import outer_facets
from sparsemor.core.testing import check_friction_law, check_normal_law


def test_pieces_of_all_facets_cover_a_surface_once() -> None:
    """Cells of a bent second surface: what lies in it is counted once, at corners too."""
    X = np.array([[1.0, 1.0], [0.0, 0.0], [1.0, -1.0]])  # convex, the body on the right
    facets = np.array([[0, 1], [1, 2]])  # run down: the body is on their left
    line = np.array([[0.2, -0.9], [0.2, 0.9]])
    a, planes = np.repeat(line[None], 2, axis=0), Planes.from_corners(X[facets])
    o, _ = Overlaps.from_pairs(Pairs(a, np.zeros_like(a), planes, cells_of(X, facets, planes)))
    pieces = Pieces.cut(o, ElasticFoundation(stiffness=1.0), None)
    length = pieces.size.sum() * 1.8
    assert length == pytest.approx(0.4, abs=1e-14)  # |y| < 0.2 on the line x = 0.2


@pytest.mark.parametrize("divisions", [(1, 1, 1), (3, 2, 2)])
def test_cells_of_a_box_tile_its_inside(divisions: tuple[int, int, int]) -> None:
    """Down to half the smallest facet each point is in the cell of one facet, edges and corners
    included: the nearest one."""
    mesh = BlockMesh(size=(0.3, 0.2, 0.2), divisions=divisions).build(Path())
    facets = outer_facets(mesh)
    planes = Planes.from_corners(mesh.points[facets])
    cells = cells_of(mesh.points, facets, planes)
    z = np.random.default_rng(0).random((4000, 3)) * [0.3, 0.2, 0.2]
    away = np.minimum(z, [0.3, 0.2, 0.2] - z).min(axis=1)
    z, away = z[away < 0.05], away[away < 0.05]
    rel = z[None] - planes.corner[:, None]
    depth = -(rel @ planes.n[:, :, None])[:, :, 0]
    eta = rel @ planes.g.transpose(0, 2, 1)
    eta[:, :, 0] += 1.0
    inside = (cells.values(eta, depth) >= 0).all(axis=2) & (depth >= 0) & (depth < 0.05)
    assert np.all(inside.sum(axis=0) == 1)
    assert np.allclose(depth[inside.argmax(axis=0), np.arange(len(z))], away)


@pytest.mark.parametrize(("d", "whole"), [(2, [1.0, 1.0 / 3.0]), (3, [0.5, 1.0 / 12.0])])
def test_parts_of_facets_keep_what_is_on_one_side_of_each_cut(d: int, whole: list[float]) -> None:
    """Random segments and triangles cut at random levels: both sides together are the whole, and
    integrals of a square over them are exact."""
    rng = np.random.default_rng(0)
    p = Parts.whole(50, d)
    points, weights = rule(d, 2)

    def measures(q: Parts, number: Any) -> Any:
        piece, corners, size = q.simplices()
        square = ((points @ corners)[:, :, 0] ** 2 @ weights) * size
        at = number[piece]
        return np.stack([np.bincount(at, weights.sum() * size, 50), np.bincount(at, square, 50)])

    every = np.arange(50)
    assert np.allclose(measures(p, every), np.array(whole)[:, None], rtol=1e-13)
    for tag in range(4):
        before, values = measures(p, every), rng.standard_normal((50, d))
        of, pieces = p.split([(values, -0.2), (values, 0.3)])
        assert np.allclose(measures(pieces, of), before, rtol=0, atol=1e-13)
        at = np.where(pieces.used, pieces.values(values[of]), np.nan)
        for level in (-0.2, 0.3):  # no piece has corners on both sides
            low, high = np.nanmin(at, axis=1), np.nanmax(at, axis=1)
            assert ((high <= level + 1e-12) | (low >= level - 1e-12)).all()
        kept, rest = (p.cut(p.values(sign * values), tag) for sign in (1.0, -1.0))
        assert np.allclose(measures(kept, every) + measures(rest, every), before, rtol=0,
                           atol=1e-13)
        cut = (kept.edges == tag) & kept.used
        assert cut.sum(axis=1).max() == 1
        assert np.abs(kept.values(values)[cut]).max() < 1e-12
        p = kept


@pytest.mark.parametrize("d", [2, 3])
def test_planes_of_facets_have_the_slopes_of_their_measure(d: int) -> None:
    rng = np.random.default_rng(d)
    a, da, h = rng.standard_normal((5, d, d)), rng.standard_normal((5, d, d)), 1e-6
    planes, n = Planes.from_corners(a), rng.standard_normal((5, d))
    assert np.allclose((planes.n * (a[:, 1] - a[:, 0])).sum(axis=1), 0.0, atol=1e-14)
    assert np.allclose(planes.g @ (a - a[:, :1]).transpose(0, 2, 1) + [[1.0], *[[0.0]] * (d - 1)],
                       np.eye(d), atol=1e-13)
    one, two = ((area_vectors(a + s * da) * n).sum(axis=1) for s in (h, -h))
    slope = (area_slopes(a, n) * da).sum(axis=(1, 2))
    assert np.allclose((one - two) / (2 * h), slope, rtol=1e-8)


@pytest.mark.parametrize("d", [2, 3])
def test_nearest_facet_is_the_nearest_of_all(d: int) -> None:
    rng = np.random.default_rng(d)
    corners = rng.random((40, d, d))
    points = 2.0 * rng.random((60, d)) - 0.5
    found = nearest(points, corners)
    every = [closest_points(points, np.broadcast_to(c, (60, d, d)))[1] for c in corners]
    assert np.allclose(found.distance, np.min(every, axis=0), atol=1e-14)
    at = (found.weights[:, :, None] * corners[found.facet]).sum(axis=1)
    assert np.allclose(np.linalg.norm(points - at, axis=1), found.distance)
    assert (found.weights >= 0).all() and np.allclose(found.weights.sum(axis=1), 1.0)
    # no other point of the facet is nearer
    others = rng.dirichlet(np.ones(d), 200)
    for i, f in enumerate(found.facet):
        far = np.linalg.norm(points[i] - others @ corners[f], axis=1)
        assert far.min() >= found.distance[i] - 1e-12


class Jumping(ElasticFoundation):
    """Pressure as soon as surfaces meet."""

    def pressure(self, depth: Any, rate: Any) -> Any:
        return 1.0 + depth, np.ones_like(depth), np.zeros_like(depth)


class Forgetful(ElasticFoundation):
    """With a wrong derivative."""

    def pressure(self, depth: Any, rate: Any) -> Any:
        return depth**2, depth, np.zeros_like(depth)


class Driving(Coulomb):
    """Friction along the slip's negative."""

    def ratio(self, slip: Any) -> Any:
        return -slip, -np.ones_like(slip)


class Sudden(Coulomb):
    """Friction that jumps, of surfaces that do not stick."""

    def ratio(self, slip: Any) -> Any:
        return np.sign(slip), np.zeros_like(slip)


def test_the_law_kit_refuses_wrong_laws() -> None:
    with pytest.raises(AssertionError, match="friction without slip"):
        check_friction_law(Sudden(coefficient=1.0, critical_velocity=1.0))
    with pytest.raises(AssertionError, match="just meet"):
        check_normal_law(Jumping(stiffness=1.0))
    with pytest.raises(AssertionError, match="derivative by depth"):
        check_normal_law(Forgetful(stiffness=1.0))
    with pytest.raises(AssertionError, match="drives the slip"):
        check_friction_law(Driving(coefficient=1.0, critical_velocity=1.0))
