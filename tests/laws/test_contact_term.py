"""The contact term keeps the laws of a term on flat, bent, open, rigid and deformed surfaces."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.coulomb import Coulomb
from sparsemor.bodies.contact.elastic_foundation import ElasticFoundation
from sparsemor.bodies.contact.pieces import Overlaps, Pairs, Pieces
from sparsemor.bodies.contact.projection import closest_points, nearest
from sparsemor.bodies.contact.quadrature import enough_points
from sparsemor.bodies.contact.term import ContactTerm
from sparsemor.core.assemble import assemble
from sparsemor.core.errors import InputError
from sparsemor.core.model import Model
from sparsemor.core.testing import (
    check_friction_law,
    check_normal_law,
    check_parts,
    check_term,
)
from sparsemor.core.testing.run import scene_of

MATERIAL = {"E": 7e8, "nu": 0.3, "rho": 2700, "alpha": 2e-5, "k": 150, "c": 900}
NORMAL = {"use": "elastic_foundation", "stiffness": 1e9, "damping": 1e5, "damping_depth": 1e-3}
FRICTION = {"use": "coulomb", "coefficient": 0.3, "critical_velocity": 0.05}


def body(
    lower: list[float], size: list[float], divisions: list[int], fields: list[str], clamp: str,
    **options: Any,
) -> dict[str, Any]:
    reference = {"reference": {"clamp": clamp}} if "elastic" in fields else {}
    return {
        "use": "flexible", "thickness": 0.02, "material": MATERIAL, "fields": fields, **reference,
        "mesh": {"use": "rectangle", "lower": lower, "size": size, "divisions": divisions},
        "sets": {"skirt": {"where": f"y < {lower[1] + 1e-9} or x > {lower[0] + size[0] - 1e-9}"}},
        **options}


def model(case: str, surfaces: str = "rigid", fields: tuple[str, ...] = (), **heat: Any) -> Model:
    """A block that stands on a plate (`flat`), over its end (`open`), on an edge of it (`bent`), or
    with an edge in it (`wedge`)."""
    x, angle, tilt, between = {
        "flat": (0.0, 0.02, 0.0, ["block:bottom", "plate:top"]),
        "open": (0.19, 0.02, 0.0, ["block:bottom", "plate:top"]),
        "bent": (0.0, 0.0, 0.8, ["plate:top", "block:skirt"]),
        "wedge": (0.0, 0.0, 0.8, ["block:skirt", "plate:top"]),
    }[case]
    of = list(fields)
    block = body([-0.05, 0.0], [0.1, 0.05], [4, 2], of, "top", pose={
        "position": [x, 0.0], "angle": angle - tilt, "velocity": [0.1, -0.01], "spin": 0.1})
    if tilt:  # its lower right corner is at the origin
        corner = np.exp(1j * (angle - tilt)) * 0.05
        block["pose"]["position"] = [-corner.real, -corner.imag]
    plate = body([-0.2, -0.1], [0.4, 0.1], [7, 2], of, "bottom",
                 pose={"angle": 0.001, "spin": 0.03})
    contact: dict[str, Any] = {"use": "polygonal", "between": between, "normal": NORMAL,
                               "friction": FRICTION, "surfaces": surfaces}
    if heat:
        contact["heat"] = heat
    return assemble(scene_of({
        "bodies": {"block": block, "plate": plate}, "contacts": {"sole": contact},
        "time": {"end": 1e-3, "step": 1e-4}}))


def term_of(model: Model) -> ContactTerm:
    (term,) = model.parts["sole"].terms(model.layout, model.parts)
    assert isinstance(term, ContactTerm)
    return term


def touches(model: Model, term: ContactTerm, seed: int, scale: float) -> bool:
    """Whether the state that the laws are tried at is one of contact."""
    x = model.x0[term.columns] + scale * np.random.default_rng(seed).standard_normal(
        len(term.columns))
    return bool(np.any(term.residual(x, 0.1 * x, 0 * x, 0.0)))


@pytest.mark.parametrize("case", ["flat", "open", "bent", "wedge"])
@pytest.mark.parametrize(("surfaces", "fields", "heat"), [
    ("rigid", (), {}),
    ("rigid", ("thermal",), {"conductance": 3e3}),
    ("deformed", ("elastic",), {}),
    ("deformed", ("elastic", "thermal"), {"share": 0.7, "conductance": 3e3}),
])
def test_every_contact_keeps_the_laws_of_a_term(
    case: str, surfaces: str, fields: tuple[str, ...], heat: dict[str, Any]
) -> None:
    m = model(case, surfaces, fields, **heat)
    term = term_of(m)
    assert any(touches(m, term, seed, 1e-3) for seed in range(4))
    for seed in range(2):
        check_term(term, np.random.default_rng(seed), base=m.x0[term.columns], scale=1e-3, trials=2)


def test_the_laws_hold_within_the_ramp_of_the_damping_and_the_critical_velocity() -> None:
    m = model("flat")
    term = term_of(m)
    x = m.x0[term.columns].copy()
    x[1] -= 4e-4
    check_term(term, np.random.default_rng(0), base=x, scale=2e-5, trials=8)


def test_a_whole_scene_with_contact_keeps_the_laws_of_parts() -> None:
    bodies = {"block": body([-0.05, 0.0], [0.1, 0.05], [2, 1], ["elastic", "thermal"], "top"),
              "plate": body([-0.2, -0.1], [0.4, 0.1], [3, 1], [], "bottom", frame="fixed")}
    check_parts(scene_of({
        "bodies": bodies, "time": {"end": 1e-3, "step": 1e-4},
        "contacts": {"sole": {
            "use": "polygonal", "between": ["block:bottom", "plate:top"], "normal": NORMAL,
            "friction": FRICTION, "heat": {"share": 0.5}, "surfaces": "deformed"}}}))


def test_restricting_to_rows_of_few_nodes_evaluates_few_facets() -> None:
    m = model("flat", "deformed", ("elastic", "thermal"), conductance=1.0)
    term = term_of(m)
    at = m.layout["block.thermal"]
    one = np.flatnonzero((term.rows >= at.start) & (term.rows < at.stop))[:1]
    assert term.elements == 4
    assert 1 <= term.restrict(one).elements <= 2
    assert term.restrict(one[:0]).elements == 0
    assert term.restrict(one[:0]).columns.size == 0


def test_required_rows_are_those_of_the_surfaces() -> None:
    m = model("flat", "deformed", ("elastic", "thermal"))
    assert len(m.required["block.elastic"]) == 2 * 5
    assert "thermal" not in str([k for k, v in m.required.items() if len(v)])
    heated = model("flat", "deformed", ("elastic", "thermal"), conductance=1.0)
    assert len(heated.required["plate.thermal"]) == 8
    assert heated.separated.other and m.separated.other


def test_nothing_is_felt_at_a_distance() -> None:
    m = model("flat", "deformed", ("elastic", "thermal"), conductance=1e4)
    term = term_of(m)
    x = m.x0[term.columns].copy()
    x[1] += 0.005  # the block's frame: higher than its tilt
    one = np.ones_like(x)
    assert not term.residual(x, one, one, 0.0).any()
    assert term.jacobian(x, one, one, 0.0, one, one).nnz == 0


def test_a_state_that_overflowed_gives_no_traceback() -> None:
    m = model("flat", "deformed", ("elastic",))
    term = term_of(m)
    x, zero = m.x0[term.columns].copy(), np.zeros(len(term.columns))
    x[0] = np.inf
    assert np.isnan(term.residual(x, zero, zero, 0.0)).all()


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


def test_quadrature_takes_the_points_that_the_laws_need() -> None:
    linear = ElasticFoundation(stiffness=1e9)
    full = ElasticFoundation(stiffness=1e9, damping=1e5, damping_depth=1e-6)
    rubbing = Coulomb(coefficient=0.2, critical_velocity=0.1)
    assert enough_points(linear, None, 1e-12) == 3
    assert enough_points(linear, None, 1e-12) <= enough_points(full, rubbing, 1e-12) <= 6

    class Rough(ElasticFoundation):
        """With a jump that it does not tell of."""

        def pressure(self, depth: Any, rate: Any) -> Any:
            return np.where(depth > 3.3e-7, 1.0, 0.0), 0 * depth, 0 * depth

    with pytest.raises(InputError, match="not smooth between"):
        enough_points(Rough(stiffness=1.0), None, 1e-6)


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


def test_a_term_knows_its_name() -> None:
    m = model("flat")
    (found,) = [t for t in m.terms if isinstance(t, ContactTerm)]
    assert found.source == "sole" and replace(found, source="x").source == "x"


def state(m: Model, term: ContactTerm, seed: int = 3) -> tuple[Any, Any]:
    """Unknowns and rates at the term's columns, in contact."""
    rng = np.random.default_rng(seed)
    x = m.x0.copy()
    n = m.layout.second.stop
    x[:n] += 1e-4 * rng.standard_normal(n)
    x[1] -= 1e-3
    v = 0.05 * rng.standard_normal(len(x))
    return x[term.columns], v[term.columns]


@pytest.mark.parametrize("surfaces", ["rigid", "deformed"])
@pytest.mark.parametrize("case", ["flat", "bent", "wedge"])
def test_forces_and_torques_of_both_bodies_cancel(case: str, surfaces: str) -> None:
    m = model(case, surfaces, ("elastic",) if surfaces == "deformed" else ())
    term = term_of(m)
    x, v = state(m, term)
    r = term.residual(x, v, 0 * x, 0.0)
    at = {name: np.searchsorted(term.rows, np.arange(*m.layout[f"{name}.rigid"].indices(99)))
          for name in ("block", "plate")}
    one, other = r[at["block"]], r[at["plate"]]
    size = np.abs(one[:2]).max()
    assert size > 1.0
    assert np.abs(one[:2] + other[:2]).max() <= 1e-13 * size
    arms = [x[i[0]] * r[i[1]] - x[i[1]] * r[i[0]] + r[i[2]] for i in at.values()]
    assert abs(sum(arms)) <= 1e-13 * size * 0.1  # the block is 0.1 m wide


@pytest.mark.parametrize("case", ["flat", "open", "wedge"])
def test_what_friction_takes_from_the_motion_enters_as_heat(case: str) -> None:
    """At any state of deformed surfaces, to round-off."""
    m = model(case, "deformed", ("elastic", "thermal"), share=0.37)
    term = term_of(m)
    x, v = state(m, term)
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
