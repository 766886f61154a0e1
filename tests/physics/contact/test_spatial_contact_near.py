"""A reduced contact on deformed surfaces in space looks at the facets near it, and at no others."""

from typing import Any

import numpy as np
import pytest

from sparsemor.bodies.contact.verlet_list import FollowedContact, MotionBound, Mover
from sparsemor.bodies.frames.attitude import attitude
from sparsemor.core import Trial
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import march, scene_of

SIDE, STEP, SPEED = 0.02, 1e-4, 20.0
FACET = SIDE / 4
MATERIAL = {"E": 2e9, "nu": 0.3, "rho": 2700}
CONTACT = {
    "use": "polygonal", "between": ["block:bottom", "plate:top"], "surfaces": "deformed",
    "tolerance": 1e-2,
    "normal": {"use": "elastic_foundation", "stiffness": 1e11, "damping": 1e5,
               "damping_depth": 1e-6},
    "friction": {"use": "coulomb", "coefficient": 0.3, "critical_velocity": 0.1}}


def scene(columns: int, steps: int, reducer: Any = "full", **frames: Any) -> Scene:
    """A block pressed on a plate of so many facets of one size; driven, unless frames are given."""
    body = {"use": "flexible", "material": MATERIAL, "fields": ["elastic"]}
    driven = {"block": {"frame": "spinning", "pose": {"velocity": [SPEED, 0.0, 0.0],
                                                      "position": [0.0, 0.0, -1e-5]}},
              "plate": {"frame": "fixed"}}
    hold = {"upright": {
        "use": "prescribed_motion", "of": "block:top", "axis": [0, 0, 1], "angle": 0.0,
        "y": {"use": "ramp", "end": 1.0, "final": 0.0},
        "x": {"use": "ramp", "end": 1.0, "final": SPEED}}}
    placed = frames or driven
    return scene_of({
        "bodies": {
            "block": {**body, "mesh": {"use": "block", "size": [SIDE, SIDE, FACET],
                                       "divisions": [4, 4, 1]},
                      "reference": {"clamp": "top"}, **placed["block"]},
            "plate": {**body, "mesh": {"use": "block", "lower": [-FACET, -FACET, -FACET],
                                       "size": [columns * FACET, SIDE + 2 * FACET, FACET],
                                       "divisions": [columns, 6, 1]},
                      "reference": {"clamp": "bottom"}, **placed["plate"]}},
        **({} if frames else {"joints": hold}), "contacts": {"sole": CONTACT},
        "loads": {"press": {"use": "pressure", "on": ["block:top"], "pressure": 1e6}},
        "time": {"end": steps * STEP, "step": STEP}, "reducer": reducer})


def facets(term: Any) -> list[int]:
    return [len(side.surface.facets) for side in term.sides]


# --------------------------------------------------------------------------- what a step costs


STEPS = 10


def pushed(columns: int) -> tuple[Any, FloatArray, int]:
    """The contact of a Galerkin model, its unknowns half-way, and how often it made a new list."""
    short = march(scene(columns, 1))
    few = scene(columns, 1, {"use": "galerkin", "basis": {"use": "pod", "count": 1}})
    learnt = {n: short.block(n).T for n in short.model.reducible()}
    solver: Any = march(few, model=short.model, snapshots=learnt).solver
    (coupled,) = solver.equations.coupled
    state, memory = solver.start(consistent_state(short.model))
    state = few.integrator.start(solver.layout, state)
    for step in range(STEPS):
        formula = step_formula(few.integrator.rules(STEP), solver.layout, state, STEP)
        outcome, memory = solver.solve(formula, memory)
        assert outcome.status.ok
        state = advanced(
                few.integrator.rules(STEP), solver.layout, state, formula, outcome)
        if step == STEPS // 2:
            x = state.x[coupled.columns]
    return coupled.term, x, memory.searches


@pytest.mark.full
def test_a_reduced_step_evaluates_the_facets_near_the_contact() -> None:
    """Four times the plate: as many facets a step, as many searches over a run of 20 mm."""
    counted = []
    for columns in (12, 48):
        whole, x, searches = pushed(columns)
        assert isinstance(whole, FollowedContact)
        assert facets(whole.term.term) == [32, 12 * columns]
        near = whole.near(x)
        assert near.some is not None
        counted.append((facets(near.some.term), searches))
        assert 2 <= searches <= 2 + STEPS * 1.2 * STEP * SPEED / whole.margin
    assert counted[0] == counted[1]
    assert counted[0][0][1] < 12 * 12


# --------------------------------------------------------------------------- what it leaves out

FREE = {"pose": {"position": [0.0, 0.0, -1e-4], "spin": [3.0, -2.0, 5.0]}}
TILTED = {"pose": {"spin": [-1.0, 2.0, 1.0]}}


def compressed(m: Model, modes: int) -> tuple[FollowedContact, FloatArray, FloatArray]:
    """The contact under frames as they are and random displacements; its unknowns and rates at the
    start. The left side looks at all rows."""
    (term,) = m.by_part["sole"]
    rng, n = np.random.default_rng(1), len(term.columns)
    rigid = np.concatenate([np.arange(m.layout.size)[m.layout[b]]
                            for b in ("block.rigid", "plate.rigid")])
    is_frame = np.isin(term.columns, rigid)
    frame, others = np.flatnonzero(is_frame), np.flatnonzero(~is_frame)
    atoms = np.zeros((n, len(frame) + modes))
    atoms[frame, np.arange(len(frame))] = 1.0
    atoms[others, len(frame):] = rng.standard_normal((len(others), modes))
    offset = np.zeros(n)
    offset[others] = 1e-6 * rng.standard_normal(len(others))
    found = term.compress(Trial(atoms, offset), rng.standard_normal((5, len(term.rows))))
    assert isinstance(found, FollowedContact)
    x, v = np.zeros(atoms.shape[1]), np.zeros(atoms.shape[1])
    x[: len(frame)] = m.x0[term.columns][frame]
    v[: len(frame)] = m.v0[term.columns][frame]
    return found, x, v


def states(x: FloatArray, margin: float, rng: np.random.Generator) -> list[FloatArray]:
    """As far from x as a list holds to either side, and some with all unknowns changed."""
    found = []
    for side in ([1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.7, -0.7]):
        there = x.copy()
        there[:2] += 0.98 * margin * np.array(side)
        found.append(there)
    for size in (1e-5, 1e-4, 5e-4):
        for _ in range(2):
            there = x + size * rng.standard_normal(len(x))
            there[-3:] *= 1e-2
            there[2] -= size
            found.append(there)
    return found


@pytest.mark.full
@pytest.mark.parametrize("plate", ["free", "spinning"])
def test_facets_left_out_cannot_touch(plate: str) -> None:
    """Wherever the list holds, what it gives is what all facets give."""
    still = TILTED if plate == "free" else {"frame": "spinning", "pose": {"spin": [0, 0, 2.0]}}
    whole, x, v = compressed(assemble(scene(24, 1, block=FREE, plate=still)), 3)
    near, rng, k = whole.near(x), np.random.default_rng(2), len(x)
    assert near.some is not None
    assert facets(near.some.term)[1] < facets(whole.term.term)[1] == 12 * 24
    c1, none, seen = np.full(k, 1.0 / STEP), np.zeros(k), 0
    for there in states(x, whole.margin, rng):
        assert near.holds(there)
        r = whole.residual(there, v, none, 0.0)
        seen += bool(r.any())
        for all_of_it, part in (
            (r, near.residual(there, v, none, 0.0)),
            (whole.jacobian(there, v, none, 0.0, c1, none),
             near.jacobian(there, v, none, 0.0, c1, none)),
        ):
            assert np.abs(all_of_it - part).max() <= 1e-11 * np.abs(all_of_it).max()
        assert whole.check_step(there, v, 0.0, STEP) == near.check_step(there, v, 0.0, STEP)
        want = whole.resultants(there, v, 0.0)
        assert near.resultants(there, v, 0.0) == pytest.approx(want, rel=1e-9)
    assert seen >= 8
    away = np.zeros(k)
    away[2] = 1.01 * whole.margin
    assert not near.holds(x + away)
    apart = whole.near(x + 20 * away)
    assert apart.some is None and not apart.residual(x + 20 * away, v, none, 0.0).any()
    x[3] = np.nan
    assert whole.near(x).some is whole.term  # nothing can be searched there


@pytest.mark.full
def test_a_step_through_the_surface_is_told_by_the_list_as_by_all_facets() -> None:
    whole, x, _ = compressed(assemble(scene(24, 1, block=FREE, plate=TILTED)), 3)
    near, reach = whole.near(x), whole.term.term.reach
    down = np.where(np.arange(len(x)) == 2, -1.0, 0.0)
    deep = x + 1.05 * reach * down
    for share in (0.2, 1.0, 20.0):  # of the depth within the step: by the list, and by all
        speed = share * reach / STEP * down
        one, other = (t.check_step(deep, speed, 0.0, STEP) for t in (near, whole))
        assert one == other != ""


# --------------------------------------------------------------------------- the bound


@pytest.mark.parametrize("frame", [0, 4, 7])
def test_no_point_moves_farther_than_the_bound(frame: int) -> None:
    """From any attitude of any length, for small and for large changes; and seldom much less."""
    rng = np.random.default_rng(3)
    n, modes = 30, 2
    X = rng.standard_normal((n, 3)) + [0.3, 0.0, 0.0]
    u = frame + np.arange(3 * n).reshape(n, 3)
    mover = Mover(X, np.zeros((0, 3), int), np.arange(frame), u)
    atoms = np.zeros((frame + 3 * n, frame + modes))
    atoms[:frame, :frame] = np.eye(frame)
    atoms[frame:, frame:] = 0.1 * rng.standard_normal((3 * n, modes))
    offset = np.zeros(len(atoms))
    offset[frame:] = 0.1 * rng.standard_normal(3 * n)
    pace = MotionBound.from_atoms(mover, atoms, offset)

    def places(x: FloatArray) -> FloatArray:
        full = offset + atoms @ x
        local = X + full[frame:].reshape(n, 3)
        if not frame:
            return local
        q = full[3:frame]
        A = attitude(q / np.linalg.norm(q) if frame == 7 else q).A
        return np.asarray(full[:3] + local @ A.T)

    shares = []
    for size in (1e-4, 1e-2, 1.0, 10.0):
        for _ in range(20):
            x = rng.standard_normal(frame + modes)
            change = size * rng.standard_normal(frame + modes)
            moved = np.linalg.norm(places(x + change) - places(x), axis=1).max()
            shares.append(moved / pace.bound(change, x))
            rate = np.linalg.norm(places(x + 1e-6 * change) - places(x), axis=1).max() / 1e-6
            assert rate <= 1.001 * pace.bound(change, x) + 1e-8 / 1e-6 * size
    assert max(shares) <= 1.0 + 1e-9 and np.median(shares) > 0.15
