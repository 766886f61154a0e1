"""Laws of a contact term in the plane and in space, on flat, bent and open surfaces."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from contact_blocks import (
    CASES,
    FRICTION,
    KINDS,
    NORMAL,
    PLANE,
    SPACE,
    STICK,
    World,
    on_a_rigid_plate,
)
from sparsemor.bodies.contact.contact_laws import Coulomb, ElasticFoundation
from sparsemor.bodies.contact.quadrature import enough_points
from sparsemor.core.errors import InputError
from sparsemor.core.testing import check_parts, check_term
from tiers import full, quick

WORLDS = {2: PLANE, 3: SPACE}
both = pytest.mark.parametrize("world", WORLDS.values(), ids=("plane", "space"))
FULL = ("deformed", ("elastic", "thermal"))
LINEAR = ElasticFoundation(stiffness=1e9)
DAMPED = ElasticFoundation(stiffness=1e9, damping=1e5, damping_depth=1e-6)
RUBBING = Coulomb(coefficient=0.2, critical_velocity=0.1)


LAID = [pytest.param(world, case, *KINDS[(i + shift) % 4],
                     id=f"{name}-{case}-{KINDS[(i + shift) % 4][0]}-{(i + shift) % 4}",
                     marks=[] if world is PLANE and (i + shift) % 4 == 3 else pytest.mark.full)
        for (i, case), (world, name, shift) in product(
            enumerate(CASES), ((PLANE, "plane", 1), (SPACE, "space", 3)))]
"""How the block lies, with which fields: each case and each kind in the plane and in space; the
default tier has everything in the plane."""


@pytest.mark.parametrize(("world", "case", "surfaces", "fields", "heat"), LAID)
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


@pytest.mark.full
@pytest.mark.parametrize(("world", "case", "surfaces", "fields", "heat"), LAID)
def test_bristles_keep_the_laws_of_a_term(
    world: World, case: str, surfaces: str, fields: tuple[str, ...], heat: dict[str, Any]
) -> None:
    """Some of them stick and some slip."""
    m = world.model(case, surfaces, fields, friction=STICK, **heat)
    term = world.term(m)
    x, rng = m.x0[term.columns].copy(), np.random.default_rng(1)
    x[world.d - 1] -= 1e-3
    at = m.layout["sole.bristles"]
    own = (term.columns >= at.start) & (term.columns < at.stop)
    x[own] = 1.2e-3 * rng.standard_normal(own.sum())
    size = np.linalg.norm(x[own].reshape(-1, world.d), axis=1)
    assert size.min() < 1e-3 < size.max()
    scale, trials = (1e-3, 3) if world is PLANE else (1e-4, 1)
    check_term(term, rng, base=x, scale=scale, trials=trials)


@both
@pytest.mark.parametrize("case", quick(["flat", "wedge"], "wedge"))
def test_what_bristles_take_from_the_motion_is_stored_or_enters_as_heat(
    world: World, case: str
) -> None:
    """At any state, to round-off: power of friction = int p Z . z' dA + heat; and without rates
    of the deflections all of it is heat, of either sign."""
    m = world.model(case, *FULL, friction=STICK, share=0.37)
    term = world.term(m)
    x, v = world.state(m, term)
    at, first = m.layout["sole.bristles"], m.layout.first.start
    own = (term.columns >= at.start) & (term.columns < at.stop)
    x[own] = 5e-4 * np.random.default_rng(0).standard_normal(own.sum())
    smooth = np.where(own, 0.0, x)
    found = []
    for rate in (0.0, 0.01, 0.02):
        now = np.where(own, rate, v)
        r = term.residual(x, now, 0 * x, 0.0)
        free = term.residual(smooth, now, 0 * x, 0.0)
        warm = (term.rows >= first) & ~own
        moves = term.rows < first
        found.append((float((r - free)[moves] @ now[moves]), -float(r[warm].sum())))
    (taken, heat), (_, less), (_, least) = found
    assert abs(taken) > 1e-3
    assert heat == pytest.approx(taken, rel=1e-11)
    assert least - less == pytest.approx(less - heat, rel=1e-9)  # linear in the rates
    assert less != heat


@pytest.mark.full
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
    assert np.isnan(term.jacobian(x, zero, zero, 0.0, zero, zero).toarray()).all()
    assert term.check_step(x, zero, 0.0, 1e-3) == ""


@both
@pytest.mark.parametrize("case", quick(["flat", "open", "wedge"], "wedge"))
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
@pytest.mark.parametrize(("case", "surfaces", "friction"), [
    ("bent", "deformed", FRICTION), full("flat", "rigid", STICK), full("wedge", "rigid", FRICTION),
    full("wedge", "deformed", STICK)])
def test_forces_and_torques_of_both_bodies_cancel(
    world: World, case: str, surfaces: str, friction: dict[str, Any]
) -> None:
    m = world.model(case, surfaces, ("elastic",) if surfaces == "deformed" else (),
                    friction=friction)
    term = world.term(m)
    x, v = world.state(m, term)
    x[term.columns >= m.layout.second.stop] = 5e-4
    x[world.d - 1] -= 5e-3  # deep: a third of it would show an arm that is left out
    r = term.residual(x, v, 0 * x, 0.0)
    force, torque, size = np.zeros(3), np.zeros(3), 0.0
    for name in ("block", "plate"):
        at = m.layout[f"{name}.rigid"]
        mine = np.searchsorted(term.rows, np.arange(at.start, at.stop))
        f, R, own = world.wrench(x[mine], r[mine])
        force, torque, size = force + f, torque + np.cross(R, f) + own, max(size, np.abs(f).max())
    assert size > 1.0
    assert np.abs(force).max() <= 1e-13 * size
    assert np.abs(torque).max() <= 1e-13 * size * world.width


@both
def test_pressure_that_changes_its_sign_on_a_facet(world: World) -> None:
    """A damper that would pull beyond the place where the foundation no longer outweighs it."""
    m = world.model("flat", normal=NORMAL | {"damping": 1e7, "damping_depth": 1e-4})
    term = world.term(m)
    n = len(term.columns)
    x, v, zero, one = m.x0[term.columns].copy(), np.zeros(n), np.zeros(n), np.ones(n)
    x[world.d - 1] -= 2e-3
    v[world.d - 1 :][: 2 * world.d - 2] = [0.1, 1.0] if world.d == 2 else [0.1, 0.3, 0.0, 2.0]
    h, way = 1e-6, np.random.default_rng(0).standard_normal(n)
    J = term.jacobian(x, v, zero, 0.0, one, zero) @ way
    ahead, behind = (term.residual(x + s * way, v + s * way, zero, 0.0) for s in (h, -h))
    assert np.abs(J).max() > 1e3
    assert np.abs((ahead - behind) / (2 * h) - J).max() < 2e-4 * np.abs(J).max()


@pytest.mark.full
def test_the_laws_hold_within_the_ramp_of_the_damping_and_the_critical_velocity() -> None:
    m = PLANE.model("flat")
    term = PLANE.term(m)
    x = m.x0[term.columns].copy()
    x[1] -= 4e-4
    check_term(term, np.random.default_rng(0), base=x, scale=2e-5, trials=8)


@pytest.mark.full
@pytest.mark.parametrize("plate", ["fixed", "spinning"])
def test_frames_that_stand_or_turn_about_an_axis(plate: str) -> None:
    m = SPACE.model("flat", plate=plate)
    term = SPACE.term(m)
    assert len(term.columns) == (7 if plate == "fixed" else 11)
    x = m.x0[term.columns].copy()
    x[2] -= 1e-3
    check_term(term, np.random.default_rng(1), base=x, scale=1e-4, trials=2)


def test_required_rows_are_those_of_the_surfaces() -> None:
    m = PLANE.model("flat", "deformed", ("elastic", "thermal"))
    assert len(m.required["block.elastic"]) == 2 * 5
    assert "thermal" not in str([k for k, v in m.required.items() if len(v)])
    heated = PLANE.model("flat", "deformed", ("elastic", "thermal"), conductance=1.0)
    assert len(heated.required["plate.thermal"]) == 8
    assert heated.separated.other and m.separated.other


def test_quadrature_takes_the_points_that_the_laws_need() -> None:
    assert enough_points(2, LINEAR, None, 1e-12) == 3
    assert 3 <= enough_points(2, DAMPED, RUBBING, 1e-12) <= 6
    assert enough_points(3, LINEAR, None, 1e-12) == 2
    few, many = (enough_points(3, DAMPED, RUBBING, tolerance) for tolerance in (1e-3, 1e-9))
    assert few <= 3 < many <= 6


@pytest.mark.parametrize("d", [2, 3])
def test_quadrature_finds_a_jump_that_a_law_does_not_tell(d: int) -> None:
    class Rough(ElasticFoundation):
        def pressure(self, depth: Any, rate: Any) -> Any:
            return np.where(depth > 3.3e-7, 1.0, 0.0), 0 * depth, 0 * depth

    with pytest.raises(InputError, match="not smooth between"):
        enough_points(d, Rough(stiffness=1.0), None, 1e-6)
