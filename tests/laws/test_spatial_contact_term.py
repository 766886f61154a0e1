"""The contact term in space keeps the laws of a term on flat, bent and open surfaces."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.coulomb import Coulomb
from sparsemor.bodies.contact.elastic_foundation import ElasticFoundation
from sparsemor.bodies.contact.spatial.cells import cells_of
from sparsemor.bodies.contact.spatial.planes import Planes
from sparsemor.bodies.contact.spatial.polygons import Polygons, fans
from sparsemor.bodies.contact.spatial.quadrature import enough_points, triangle_rule
from sparsemor.bodies.contact.spatial.term import SpatialContactTerm
from sparsemor.bodies.mesh.block import Block
from sparsemor.bodies.mesh.simplices import boundary
from sparsemor.bodies.spatial.attitude import attitude
from sparsemor.bodies.spatial.rotation import about, product
from sparsemor.core.assemble import assemble
from sparsemor.core.errors import InputError
from sparsemor.core.model import Model
from sparsemor.core.testing import check_parts, check_term
from sparsemor.core.testing.run import scene_of

MATERIAL = {"E": 7e8, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 150, "c": 900}
NORMAL = {"use": "elastic_foundation", "stiffness": 1e9, "damping": 1e5, "damping_depth": 1e-3}
FRICTION = {"use": "coulomb", "coefficient": 0.3, "critical_velocity": 0.05}


def body(
    lower: list[float], size: list[float], divisions: list[int], fields: list[str], clamp: str,
    **options: Any,
) -> dict[str, Any]:
    reference = {"reference": {"clamp": clamp}} if "elastic" in fields else {}
    skirt = f"z < {lower[2] + 1e-9} or x > {lower[0] + size[0] - 1e-9}"
    return {
        "use": "flexible", "material": MATERIAL, "fields": fields, **reference,
        "mesh": {"use": "block", "lower": lower, "size": size, "divisions": divisions},
        "sets": {"skirt": {"where": skirt}}, **options}


def turned(*parts: tuple[list[float], float]) -> np.ndarray:
    """Quaternion of turns about axes, the first one last."""
    q = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in parts:
        q = product(q, about(axis, angle))
    return q


def model(
    case: str, surfaces: str = "rigid", fields: tuple[str, ...] = (), plate: str | None = None,
    normal: dict[str, Any] = NORMAL, **heat: Any,
) -> Model:
    """A block on a plate (`flat`), over its end (`open`), on an edge of it (`bent`), or with an
    edge in it (`wedge`)."""
    x, tilt, between = {
        "flat": (0.0, 0.0, ["block:bottom", "plate:top"]),
        "open": (0.19, 0.0, ["block:bottom", "plate:top"]),
        "bent": (0.0, 0.8, ["plate:top", "block:skirt"]),
        "wedge": (0.0, 0.8, ["block:skirt", "plate:top"]),
    }[case]
    of = list(fields)
    q = turned(([0, 0, 1], 0.3), ([0, 1, 0], tilt or 0.02))
    block = body([-0.05, -0.03, 0.0], [0.1, 0.06, 0.05], [2, 1, 1], of, "top", pose={
        "position": [x, 0.0, 0.0], "quaternion": q.tolist(), "velocity": [0.1, 0.05, -0.01],
        "spin": [0.1, 0.2, -0.3]})
    if tilt:  # its lower right edge is at the height of the origin
        corner = attitude(q).A @ [0.05, 0.0, 0.0]
        block["pose"]["position"] = (-corner).tolist()
    still: dict[str, Any] = {"frame": plate} if plate else {
        "pose": {"quaternion": turned(([1, 1, 0], 0.001)).tolist(), "spin": [0.0, 0.1, 0.03]}}
    base = body([-0.2, -0.1, -0.1], [0.4, 0.2, 0.1], [4, 2, 1], of, "bottom", **still)
    contact: dict[str, Any] = {"use": "polygonal", "between": between, "normal": normal,
                               "friction": FRICTION, "surfaces": surfaces, "tolerance": 1e-3}
    if heat:
        contact["heat"] = heat
    return assemble(scene_of({
        "bodies": {"block": block, "plate": base}, "contacts": {"sole": contact},
        "time": {"end": 1e-3, "step": 1e-4}}))


def term_of(model: Model) -> SpatialContactTerm:
    (term,) = model.parts["sole"].terms(model.layout, model.parts)
    assert isinstance(term, SpatialContactTerm)
    return term


def state(m: Model, term: SpatialContactTerm, seed: int = 3) -> tuple[Any, Any]:
    """Unknowns and rates at the term's columns, in contact."""
    rng = np.random.default_rng(seed)
    x, v = m.x0.copy(), m.v0.copy()
    n = m.layout.second.stop
    x[:n] += 1e-4 * rng.standard_normal(n)
    x[2] -= 1e-3
    v[:n] += 0.05 * rng.standard_normal(n)
    return x[term.columns], v[term.columns]


@pytest.mark.parametrize(("surfaces", "fields", "heat"), [
    ("rigid", (), {}),
    ("rigid", ("thermal",), {"conductance": 1e3, "share": 0.3}),
    ("deformed", ("elastic",), {}),
    ("deformed", ("elastic", "thermal"), {"conductance": 1e3}),
])
@pytest.mark.parametrize("case", ["flat", "open", "bent", "wedge"])
def test_the_term_keeps_the_laws_of_a_term(
    case: str, surfaces: str, fields: tuple[str, ...], heat: dict[str, Any]
) -> None:
    m = model(case, surfaces, fields, **heat)
    term = term_of(m)
    x = m.x0[term.columns].copy()
    x[2] -= 1e-3
    assert np.abs(term.residual(x, 0 * x, 0 * x, 0.0)).max() > 1.0
    check_term(term, np.random.default_rng(0), base=x, scale=1e-4, trials=1)


@pytest.mark.parametrize("plate", ["fixed", "spinning"])
def test_frames_that_stand_or_turn_about_an_axis(plate: str) -> None:
    m = model("flat", plate=plate)
    term = term_of(m)
    assert len(term.columns) == (7 if plate == "fixed" else 11)
    x = m.x0[term.columns].copy()
    x[2] -= 1e-3
    check_term(term, np.random.default_rng(1), base=x, scale=1e-4, trials=2)


def test_a_whole_scene_with_contact_keeps_the_laws_of_parts() -> None:
    bodies = {"block": body([-0.05, -0.03, 0.0], [0.1, 0.06, 0.05], [1, 1, 1],
                            ["elastic", "thermal"], "top"),
              "plate": body([-0.2, -0.1, -0.1], [0.4, 0.2, 0.1], [2, 1, 1], [], "bottom",
                            frame="fixed")}
    check_parts(scene_of({
        "bodies": bodies, "time": {"end": 1e-3, "step": 1e-4},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["block:bottom", "plate:top"], "normal": NORMAL,
            "friction": FRICTION, "heat": {"share": 0.5}, "surfaces": "deformed"}}}), trials=1)


@pytest.mark.parametrize("surfaces", ["rigid", "deformed"])
@pytest.mark.parametrize("case", ["flat", "bent", "wedge"])
def test_forces_and_torques_of_both_bodies_cancel(case: str, surfaces: str) -> None:
    m = model(case, surfaces, ("elastic",) if surfaces == "deformed" else ())
    term = term_of(m)
    x, v = state(m, term)
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


@pytest.mark.parametrize("case", ["flat", "open", "wedge"])
def test_what_friction_takes_from_the_motion_enters_as_heat(case: str) -> None:
    """At any state of deformed surfaces, to round-off."""
    m = model(case, "deformed", ("elastic", "thermal"), share=0.37)
    term = term_of(m)
    x, v = state(m, term)
    for name in ("block", "plate"):  # rates that keep the quaternions' length
        at = np.searchsorted(term.rows, np.arange(7)[3:] + m.layout[f"{name}.rigid"].start)
        x[at] /= np.linalg.norm(x[at])
        v[at] -= x[at] * (x[at] @ v[at])
    smooth = replace(term, face=replace(term.face, friction=None))
    first = m.layout.first.start
    warm = term.rows >= first
    r = term.residual(x, v, 0 * x, 0.0)
    taken = float((r - smooth.residual(x, v, 0 * x, 0.0))[~warm] @ v[term.columns < first])
    assert taken > 1e-3
    assert -r[warm].sum() == pytest.approx(taken, rel=1e-11)
    block = m.layout["block.thermal"]
    mine = (term.rows >= block.start) & (term.rows < block.stop)
    assert -r[mine].sum() == pytest.approx(0.37 * taken, rel=1e-11)


def test_pressure_that_changes_its_sign_on_a_facet() -> None:
    """A damper that would pull behind the line where the foundation no longer outweighs it."""
    strong = NORMAL | {"damping": 1e7, "damping_depth": 1e-4}
    m = model("flat", normal=strong, plate="fixed")
    term = term_of(m)
    x, v = m.x0[term.columns].copy(), np.zeros(7)
    x[2] -= 2e-3
    v[2:] = [0.1, 0.3, 0.0, 2.0, 0.0]
    h, d = 1e-6, np.random.default_rng(0).standard_normal(7)
    zero, one = np.zeros(7), np.ones(7)
    J = term.jacobian(x, v, zero, 0.0, one, zero) @ d
    ahead, behind = (term.residual(x + s * d, v + s * d, zero, 0.0) for s in (h, -h))
    assert np.abs(J).max() > 1e3
    assert np.abs((ahead - behind) / (2 * h) - J).max() < 2e-4 * np.abs(J).max()


def test_restricting_to_rows_of_few_nodes_evaluates_few_facets() -> None:
    m = model("flat", "deformed", ("elastic", "thermal"), conductance=1.0)
    term = term_of(m)
    at = m.layout["block.thermal"]
    one = np.flatnonzero((term.rows >= at.start) & (term.rows < at.stop))[:1]
    assert term.elements == 4
    assert 1 <= term.restrict(one).elements <= 3
    assert term.restrict(one[:0]).elements == 0
    assert term.restrict(one[:0]).columns.size == 0


def test_nothing_is_felt_at_a_distance() -> None:
    m = model("flat", "deformed", ("elastic", "thermal"), conductance=1e4)
    term = term_of(m)
    x = m.x0[term.columns].copy()
    x[2] += 0.005  # the block's frame: higher than its tilt
    one = np.ones_like(x)
    assert not term.residual(x, one, one, 0.0).any()
    assert term.jacobian(x, one, one, 0.0, one, one).nnz == 0


def test_a_state_that_overflowed_gives_no_traceback() -> None:
    m = model("flat", "deformed", ("elastic",))
    term = term_of(m)
    x, zero = m.x0[term.columns].copy(), np.zeros(len(term.columns))
    x[0] = np.inf
    assert np.isnan(term.residual(x, zero, zero, 0.0)).all()
    assert np.isnan(term.jacobian(x, zero, zero, 0.0, zero, zero).toarray()).all()
    assert term.doubt(x, zero, 0.0, 1e-3) == ""


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


def test_quadrature_takes_the_points_that_the_laws_need() -> None:
    linear = ElasticFoundation(stiffness=1e9)
    full = ElasticFoundation(stiffness=1e9, damping=1e5, damping_depth=1e-6)
    rubbing = Coulomb(coefficient=0.2, critical_velocity=0.1)
    assert enough_points(linear, None, 1e-12) == 2
    few, many = (enough_points(full, rubbing, tolerance) for tolerance in (1e-3, 1e-9))
    assert few <= 3 < many <= 6

    class Rough(ElasticFoundation):
        """With a jump that it does not tell of."""

        def pressure(self, depth: Any, rate: Any) -> Any:
            return np.where(depth > 3.3e-7, 1.0, 0.0), 0 * depth, 0 * depth

    with pytest.raises(InputError, match="not smooth between"):
        enough_points(Rough(stiffness=1.0), None, 1e-6)
