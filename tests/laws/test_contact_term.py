"""What a contact term keeps in the plane and in space alike, on flat, bent and open surfaces."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from contact_blocks import CASES, KINDS, PLANE, SPACE, World, on_a_rigid_plate
from sparsemor.bodies.contact.coulomb import Coulomb
from sparsemor.bodies.contact.elastic_foundation import ElasticFoundation
from sparsemor.bodies.contact.quadrature import enough_points as points_in_plane
from sparsemor.bodies.contact.spatial.quadrature import enough_points as points_in_space
from sparsemor.core.errors import InputError
from sparsemor.core.testing import check_parts, check_term

WORLDS = {2: PLANE, 3: SPACE}
both = pytest.mark.parametrize("world", WORLDS.values(), ids=("plane", "space"))
FULL = ("deformed", ("elastic", "thermal"))
LINEAR = ElasticFoundation(stiffness=1e9)
DAMPED = ElasticFoundation(stiffness=1e9, damping=1e5, damping_depth=1e-6)
RUBBING = Coulomb(coefficient=0.2, critical_velocity=0.1)


@both
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("surfaces", "fields", "heat"), KINDS)
def test_every_contact_keeps_the_laws_of_a_term(
    world: World, case: str, surfaces: str, fields: tuple[str, ...], heat: dict[str, Any]
) -> None:
    m = world.model(case, surfaces, fields, **heat)
    term = world.term(m)
    x = m.x0[term.columns].copy()
    x[world.d - 1] -= 1e-3
    assert np.abs(term.residual(x, 0 * x, 0 * x, 0.0)).max() > 1.0
    scale, trials = (1e-3, 4) if world is PLANE else (1e-4, 1)  # facets in space are slower
    check_term(term, np.random.default_rng(0), base=x, scale=scale, trials=trials)


@pytest.mark.parametrize("d", [2, 3])
def test_a_whole_scene_with_contact_keeps_the_laws_of_parts(d: int) -> None:
    check_parts(on_a_rigid_plate(d), trials=1)


@both
def test_restricting_to_rows_of_few_nodes_evaluates_few_facets(world: World) -> None:
    m = world.model("flat", *FULL, conductance=1.0)
    term = world.term(m)
    at = m.layout["block.thermal"]
    one = np.flatnonzero((term.rows >= at.start) & (term.rows < at.stop))[:1]
    assert term.elements == 4
    assert 1 <= term.restrict(one).elements <= world.most
    assert term.restrict(one[:0]).elements == 0
    assert term.restrict(one[:0]).columns.size == 0


@both
def test_nothing_is_felt_at_a_distance(world: World) -> None:
    m = world.model("flat", *FULL, conductance=1e4)
    term = world.term(m)
    x = m.x0[term.columns].copy()
    x[world.d - 1] += 0.005  # the block's frame: higher than its tilt
    one = np.ones_like(x)
    assert not term.residual(x, one, one, 0.0).any()
    assert term.jacobian(x, one, one, 0.0, one, one).nnz == 0


@both
def test_a_state_that_overflowed_gives_no_traceback(world: World) -> None:
    m = world.model("flat", "deformed", ("elastic",))
    term = world.term(m)
    x, zero = m.x0[term.columns].copy(), np.zeros(len(term.columns))
    x[0] = np.inf
    assert np.isnan(term.residual(x, zero, zero, 0.0)).all()


@both
@pytest.mark.parametrize("case", ["flat", "open", "wedge"])
def test_what_friction_takes_from_the_motion_enters_as_heat(world: World, case: str) -> None:
    """At any state of deformed surfaces, to round-off."""
    m = world.model(case, *FULL, share=0.37)
    term = world.term(m)
    x, v = world.state(m, term)
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


@both
def test_a_term_knows_its_name(world: World) -> None:
    m = world.model("flat")
    (found,) = [t for t in m.terms if isinstance(t, world.kind)]
    assert found.source == "sole" and replace(found, source="x").source == "x"


def test_quadrature_takes_the_points_that_the_laws_need() -> None:
    assert points_in_plane(LINEAR, None, 1e-12) == 3
    assert 3 <= points_in_plane(DAMPED, RUBBING, 1e-12) <= 6
    assert points_in_space(LINEAR, None, 1e-12) == 2
    few, many = (points_in_space(DAMPED, RUBBING, tolerance) for tolerance in (1e-3, 1e-9))
    assert few <= 3 < many <= 6


@pytest.mark.parametrize("enough", [points_in_plane, points_in_space])
def test_quadrature_finds_a_jump_that_a_law_does_not_tell(enough: Any) -> None:
    class Rough(ElasticFoundation):
        def pressure(self, depth: Any, rate: Any) -> Any:
            return np.where(depth > 3.3e-7, 1.0, 0.0), 0 * depth, 0 * depth

    with pytest.raises(InputError, match="not smooth between"):
        enough(Rough(stiffness=1.0), None, 1e-6)
