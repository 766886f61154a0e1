"""Contact in the plane: its ramps, rows, pieces, forces; the kit of its laws; nearest facets."""

from typing import Any

import numpy as np
import pytest

from contact_blocks import PLANE
from sparsemor.bodies.contact.coulomb import Coulomb
from sparsemor.bodies.contact.elastic_foundation import ElasticFoundation
from sparsemor.bodies.contact.pieces import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.projection import closest_points, nearest
from sparsemor.core.testing import (
    check_friction_law,
    check_normal_law,
    check_term,
)


def test_the_laws_hold_within_the_ramp_of_the_damping_and_the_critical_velocity() -> None:
    m = PLANE.model("flat")
    term = PLANE.term(m)
    x = m.x0[term.columns].copy()
    x[1] -= 4e-4
    check_term(term, np.random.default_rng(0), base=x, scale=2e-5, trials=8)


def test_required_rows_are_those_of_the_surfaces() -> None:
    m = PLANE.model("flat", "deformed", ("elastic", "thermal"))
    assert len(m.required["block.elastic"]) == 2 * 5
    assert "thermal" not in str([k for k, v in m.required.items() if len(v)])
    heated = PLANE.model("flat", "deformed", ("elastic", "thermal"), conductance=1.0)
    assert len(heated.required["plate.thermal"]) == 8
    assert heated.separated.other and m.separated.other


def test_pieces_of_all_facets_cover_a_surface_once() -> None:
    """Cells of a bent second surface: what lies in it is counted once, at corners too."""
    corner = np.array([1.0 + 1j, 0.0, 1.0 - 1j])  # convex, the body on the right
    facets = np.stack([corner[:-1], corner[1:]], axis=1)  # runs down: body on its left
    line = np.array([0.2 + 0.9j, 0.2 - 0.9j])[::-1]
    z = np.concatenate([np.repeat(line[None], 2, axis=0), facets], axis=1)
    turn = np.tan(np.angle((facets[1, 1] - facets[1, 0]) / (facets[0, 1] - facets[0, 0])) / 2)
    o, _ = Overlaps.of(Pairs(z, np.zeros_like(z), np.array([[0.0, turn], [turn, 0.0]])))
    pieces = Pieces.cut(o, ElasticFoundation(stiffness=1.0), None)
    length = (pieces.stop - pieces.start).sum() * abs(line[1] - line[0])
    assert length == pytest.approx(0.4, abs=1e-14)  # |y| < 0.2 on the line x = 0.2


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


def test_the_law_kit_refuses_wrong_laws() -> None:
    with pytest.raises(AssertionError, match="just meet"):
        check_normal_law(Jumping(stiffness=1.0))
    with pytest.raises(AssertionError, match="derivative by depth"):
        check_normal_law(Forgetful(stiffness=1.0))
    with pytest.raises(AssertionError, match="drives the slip"):
        check_friction_law(Driving(coefficient=1.0, critical_velocity=1.0))


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


def test_the_gap_has_the_sign_of_the_outward_normal() -> None:
    top = np.array([[[1.0, 0.0], [0.0, 0.0]]])  # runs to the left: outward is up
    assert nearest(np.array([[0.5, 0.2], [0.5, -0.3]]), top).gap == pytest.approx([0.2, -0.3])
    face = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])  # counter-clockwise from above
    assert nearest(np.array([[0.2, 0.2, 0.4]]), face).gap == pytest.approx([0.4])


@pytest.mark.parametrize("surfaces", ["rigid", "deformed"])
@pytest.mark.parametrize("case", ["flat", "bent", "wedge"])
def test_forces_and_torques_of_both_bodies_cancel(case: str, surfaces: str) -> None:
    m = PLANE.model(case, surfaces, ("elastic",) if surfaces == "deformed" else ())
    term = PLANE.term(m)
    x, v = PLANE.state(m, term)
    r = term.residual(x, v, 0 * x, 0.0)
    at = {name: np.searchsorted(term.rows, np.arange(*m.layout[f"{name}.rigid"].indices(99)))
          for name in ("block", "plate")}
    one, other = r[at["block"]], r[at["plate"]]
    size = np.abs(one[:2]).max()
    assert size > 1.0
    assert np.abs(one[:2] + other[:2]).max() <= 1e-13 * size
    arms = [x[i[0]] * r[i[1]] - x[i[1]] * r[i[0]] + r[i[2]] for i in at.values()]
    assert abs(sum(arms)) <= 1e-13 * size * 0.1  # the block is 0.1 m wide


