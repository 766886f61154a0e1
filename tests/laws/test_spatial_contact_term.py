"""Contact in space: frames that stand or turn, forces, cells, polygons."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contact_blocks import NORMAL, SPACE
from sparsemor.bodies.contact.spatial.cells import cells_of
from sparsemor.bodies.contact.spatial.planes import Planes
from sparsemor.bodies.contact.spatial.polygons import Polygons, fans
from sparsemor.bodies.contact.spatial.quadrature import triangle_rule
from sparsemor.bodies.mesh.block import Block
from sparsemor.bodies.mesh.simplices import boundary
from sparsemor.bodies.spatial.attitude import attitude
from sparsemor.core.testing import check_term


@pytest.mark.parametrize("plate", ["fixed", "spinning"])
def test_frames_that_stand_or_turn_about_an_axis(plate: str) -> None:
    m = SPACE.model("flat", plate=plate)
    term = SPACE.term(m)
    assert len(term.columns) == (7 if plate == "fixed" else 11)
    x = m.x0[term.columns].copy()
    x[2] -= 1e-3
    check_term(term, np.random.default_rng(1), base=x, scale=1e-4, trials=2)


@pytest.mark.parametrize("surfaces", ["rigid", "deformed"])
@pytest.mark.parametrize("case", ["flat", "bent", "wedge"])
def test_forces_and_torques_of_both_bodies_cancel(case: str, surfaces: str) -> None:
    m = SPACE.model(case, surfaces, ("elastic",) if surfaces == "deformed" else ())
    term = SPACE.term(m)
    x, v = SPACE.state(m, term)
    x[2] -= 5e-3  # deep: a third of it would show an arm that is left out
    r = term.residual(x, v, 0 * x, 0.0)
    force, torque, size = np.zeros(3), np.zeros(3), 0.0
    for name in ("block", "plate"):
        at = m.layout[f"{name}.rigid"]
        mine = np.searchsorted(term.rows, np.arange(at.start, at.stop))
        turn = attitude(x[mine[3:]] / np.linalg.norm(x[mine[3:]]))
        # rows of the quaternion are lever @ torque, and lever.T @ lever = 4
        own = turn.lever().T @ r[mine[3:]] / 4.0 * np.linalg.norm(x[mine[3:]])
        force += r[mine[:3]]
        torque += np.cross(x[mine[:3]], r[mine[:3]]) + turn.A @ own
        size = max(size, np.abs(r[mine[:3]]).max())
    assert size > 1.0
    assert np.abs(force).max() <= 1e-13 * size
    assert np.abs(torque).max() <= 1e-13 * size * 0.2  # the plate is 0.2 m deep


def test_pressure_that_changes_its_sign_on_a_facet() -> None:
    """A damper that would pull behind the line where the foundation no longer outweighs it."""
    strong = NORMAL | {"damping": 1e7, "damping_depth": 1e-4}
    m = SPACE.model("flat", normal=strong, plate="fixed")
    term = SPACE.term(m)
    x, v = m.x0[term.columns].copy(), np.zeros(7)
    x[2] -= 2e-3
    v[2:] = [0.1, 0.3, 0.0, 2.0, 0.0]
    h, d = 1e-6, np.random.default_rng(0).standard_normal(7)
    zero, one = np.zeros(7), np.ones(7)
    J = term.jacobian(x, v, zero, 0.0, one, zero) @ d
    ahead, behind = (term.residual(x + s * d, v + s * d, zero, 0.0) for s in (h, -h))
    assert np.abs(J).max() > 1e3
    assert np.abs((ahead - behind) / (2 * h) - J).max() < 2e-4 * np.abs(J).max()


@pytest.mark.parametrize("divisions", [(1, 1, 1), (3, 2, 2)])
def test_cells_of_a_box_tile_its_inside(divisions: tuple[int, int, int]) -> None:
    """Down to half the smallest facet each point is in the cell of one facet, edges and corners
    included: the nearest one."""
    mesh = Block(size=(0.3, 0.2, 0.2), divisions=divisions).build(Path())
    facets = boundary(mesh)
    planes = Planes.of(mesh.points[facets])
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


def test_polygons_keep_what_is_on_one_side_of_each_cut() -> None:
    """Random triangles cut by random lines: both sides together are the whole, and integrals of a
    square over them are exact."""
    rng = np.random.default_rng(0)
    p = Polygons.whole(50)
    points, weights = triangle_rule(2)

    def areas(q: Polygons) -> Any:
        of, corners, size = fans(q)
        square = ((points @ corners)[:, :, 0] ** 2 @ weights) * size
        return np.stack([np.bincount(of, 0.5 * size, 50), np.bincount(of, square, 50)])

    assert np.allclose(areas(p), [[0.5], [1.0 / 12.0]], rtol=1e-13)
    for tag in range(4):
        before, values = areas(p), rng.standard_normal((50, 3))
        kept, rest = (p.cut(p.values(sign * values), tag) for sign in (1.0, -1.0))
        assert np.allclose(areas(kept) + areas(rest), before, rtol=0, atol=1e-13)
        cut = (kept.edges == tag) & kept.used
        assert cut.sum(axis=1).max() == 1
        ends = kept.values(values)
        assert np.abs(ends[cut]).max() < 1e-12
        p = kept


def test_the_jacobian_of_a_state_that_overflowed_is_nan_and_nothing_is_doubted() -> None:
    m = SPACE.model("flat", "deformed", ("elastic",))
    term = SPACE.term(m)
    x, zero = m.x0[term.columns].copy(), np.zeros(len(term.columns))
    x[0] = np.inf
    assert np.isnan(term.jacobian(x, zero, zero, 0.0, zero, zero).toarray()).all()
    assert term.doubt(x, zero, 0.0, 1e-3) == ""
