"""Contact on deformed surfaces inside the step: a slider pressed on a plate and pushed along."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sparsemor.core.arrays import FloatArray
from sparsemor.core.charts import write_run_charts
from sparsemor.core.equations import rate_factors
from sparsemor.core.initial import consistent_state
from sparsemor.core.model import Model
from sparsemor.core.protocols import StepFormula
from sparsemor.core.results import RunResult
from sparsemor.core.scene import Scene
from sparsemor.core.simulate import simulate
from sparsemor.core.status import SolveFailed, Status
from sparsemor.core.testing.reducer import check_reducer
from sparsemor.core.testing.run import March, march, scene_of
from sparsemor.reducers.general import GeneralStepper, Summed
from sparsemor.reducers.reduced_general import ReducedGeneral

SIDE, STEP = 1.25e-3, 3.75e-6
LOAD = 10e6 * SIDE**2
"""N on the slider."""
BOTH = ["elastic", "thermal"]


def scene(
    fields: list[str], *, stiffer: float = 1.0, plate: tuple[int, int] = (18, 4), steps: int = 40,
    conductance: float = 0.0, surfaces: str = "deformed", slider: dict[str, Any] | None = None,
    reducer: Any = "full",
) -> Scene:
    """The paper's slider and plate on coarse meshes; friction drags, so the slider tilts."""
    material = {"E": 70e9 * stiffer, "nu": 0.3, "rho": 2700, "alpha": 2.38e-5, "k": 150, "c": 900}
    body = {"use": "flexible", "thickness": SIDE, "material": material, "model": "plane_strain",
            "fields": fields, "reference_temperature": 0.0}
    holds = "elastic" in fields
    contact: dict[str, Any] = {
        "use": "polygonal", "between": ["slider:bottom", "plate:top"], "surfaces": surfaces,
        "normal": {"use": "elastic_foundation", "stiffness": 6.11e13, "damping": 6.1214e4,
                   "damping_depth": 1e-9},
        "friction": {"use": "coulomb", "coefficient": 0.2, "critical_velocity": 0.05}}
    if "thermal" in fields:
        contact["heat"] = {"share": "effusivity", "conductance": conductance}
    return scene_of({
        "bodies": {
            "slider": {**body, "pose": {"velocity": [1.0, 0.0]}, **(slider or {}),
                       "mesh": {"use": "rectangle", "size": [SIDE, SIDE], "divisions": [6, 6]},
                       "sets": {"drive": {"nearest": [SIDE / 2, SIDE]}},
                       **({"reference": {"chord": ["top_left", "top_right"]}} if holds else {})},
            "plate": {**body, "frame": "fixed",
                      "mesh": {"use": "rectangle", "lower": [0.0, -SIDE],
                               "size": [plate[0] / 18 * 4 * SIDE, SIDE], "divisions": list(plate)},
                      **({"reference": {"clamp": "bottom"}} if holds else {})}},
        "joints": {"drive": {"use": "prescribed_motion", "of": "slider:drive",
                             "x": {"use": "ramp", "end": 1.0, "final": 1.0}}},
        "contacts": {"sole": contact},
        "loads": {"press": {"use": "traction", "on": ["slider:top"], "axes": "space",
                            "traction": [0.0, -10e6]}},
        "time": {"end": steps * STEP, "step": STEP}, "reducer": reducer})


@cache
def full() -> March:
    return march(scene(BOTH))


def learnt(run: March) -> dict[str, FloatArray]:
    return {n: run.block(n).T for n in run.model.reducible()}


def decoded(run: March, name: str) -> FloatArray:
    x, maps = run.block(name), run.solver.dictionaries
    return x if name not in maps else np.asarray(maps[name].offset + x @ maps[name].atoms.T)


def forces(run: March) -> FloatArray:
    """(n,) what the contact adds to the forces and heats of all unknowns at the end."""
    term, end = run.model.separated.other[0], run.end
    j, out = term.columns, np.zeros(run.model.layout.size)
    out[term.rows] = -term.residual(end.x[j], end.v[j], end.a[j], end.t)
    return out


def stored(model: Model, x: FloatArray) -> FloatArray:
    """(M,) heat in all bodies above 0, J, for states in rows."""
    return np.asarray(sum(x[:, model.layout[h.thermal]] @ h.capacity.sum(axis=0)
                          for h in model.separated.heat))


# --------------------------------------------------------------------------- mechanics


def test_the_contact_carries_the_load_and_drags() -> None:
    run = full()
    assert isinstance(run.solver, GeneralStepper)
    x, y, _ = forces(run)[run.model.layout["slider.rigid"]]
    assert abs(y - LOAD) < 2e-4 * LOAD
    # along the deformed surface, which is all but level
    assert abs(x + 0.2 * LOAD) < 2e-3 * LOAD
    assert abs(run.block("drive.multiplier")[-1, 0] - x) < 2e-3 * LOAD


def test_third_law_for_forces_moments_and_heat() -> None:
    run = full()
    f, layout = forces(run), run.model.layout
    on_slider = f[layout["slider.rigid"]]
    plate: Any = run.model.parts["plate"]
    nodal = np.zeros(2 * len(plate.X))
    nodal[plate.elasticity.free] = f[layout["plate.elastic"]]
    moved = np.zeros_like(nodal)
    moved[plate.elasticity.free] = run.end.x[layout["plate.elastic"]]
    x, y, angle = run.end.x[layout["slider.rigid"]]
    arm = plate.X + moved.view(complex) - complex(x, y)
    moment = float((arm.conj() * nodal.view(complex)).imag.sum())
    size = LOAD * SIDE
    assert abs(nodal.view(complex).sum() + complex(on_slider[0], on_slider[1])) < 1e-12 * LOAD
    assert abs(moment + on_slider[2]) < 1e-12 * size
    # forces on the slider's nodes are those on its frame
    nodes = f[layout["slider.elastic"]]
    assert np.abs(nodes).max() > 0.01 * LOAD


def test_stiff_bodies_move_as_rigid_ones() -> None:
    """The difference is the bodies' own give, in proportion to 1 / E."""
    rigid = march(scene([], surfaces="rigid")).block("slider.rigid")[-1]
    off = []
    for stiffer in (100.0, 1000.0):
        pose = march(scene(["elastic"], stiffer=stiffer)).block("slider.rigid")[-1]
        off.append(abs(pose[2] / rigid[2] - 1.0))
    assert off[0] < 0.03 and 8.0 < off[0] / off[1] < 12.0, off
    soft = march(scene(["elastic"])).block("slider.rigid")[-1]
    assert abs(soft[2] / rigid[2]) > 1.3


# --------------------------------------------------------------------------- the iteration


def changes(model: Model, step: StepFormula, x: FloatArray, exact: bool, count: int) -> FloatArray:
    """Sizes of successive changes from x, relative to the largest displacement of the plate."""
    eq = Summed.of(model, price=1)
    c1, c2 = rate_factors(model.layout, step.c1, step.c2, step.c1_first)
    given, factor, found = eq.given(step.t), None, []
    at = model.layout["plate.elastic"]
    for _ in range(count):
        v, a = c1 * x + step.r1, c2 * x + step.r2
        if exact or factor is None:
            factor = eq.factorize(eq.jacobian(x, v, a, step.t, c1, c2))
        dx = factor.solve(eq.residual(x, v, a, step.t, given))
        x = x - dx
        found.append(float(np.abs(dx[at]).max() / np.abs(x[at]).max()))
    return np.array(found)


def test_exact_jacobians_converge_quadratically_and_a_kept_one_linearly() -> None:
    run = full()
    integrator = scene(BOTH).integrator
    state = integrator.start(run.model.layout, run.end)
    step = integrator.formula(run.model.layout, state, STEP)
    x = 2 * run.x[-1] - run.x[-2]
    x[run.model.layout["plate.elastic"]] *= 1.005
    newton = changes(run.model, step, x, exact=True, count=3)
    chord = changes(run.model, step, x, exact=False, count=4)
    assert newton[1] < 0.1 * newton[0] ** 2 and newton[2] < 1e-11
    first, second = chord[2:] / chord[1:-1]
    assert first < 0.05 and 0.2 < first / second < 5.0
    assert chord[2] > 100 * newton[2]


def test_few_factors_serve_many_steps() -> None:
    run = full()
    solver: Any = run.solver
    state, memory = solver.start(run.end)
    integrator = scene(BOTH).integrator
    state = integrator.start(solver.layout, state)
    iterations = 0
    for _ in range(20):
        formula = integrator.formula(solver.layout, state, STEP)
        outcome, memory = solver.solve(formula, memory)
        assert outcome.status.ok
        iterations += outcome.iterations
        state = integrator.advance(solver.layout, state, formula, outcome.x, STEP)
    assert solver.counters(memory)["factorizations"] <= 8 and iterations <= 160


# --------------------------------------------------------------------------- reduced


@pytest.mark.parametrize("reducer", [
    {"use": "galerkin"},
    {"use": "sparse", "sampler": "deim", "budgets": {"*.elastic": {"rows": 40},
                                                     "*.thermal": {"rows": 30}}}], ids=str)
def test_a_reduced_run_repeats_its_training(reducer: dict[str, Any]) -> None:
    reference = full()
    made = {**reducer, "basis": {"use": "pod", "count": 20}}
    run = march(scene(BOTH, reducer=made), model=reference.model, snapshots=learnt(reference))
    assert isinstance(run.solver, ReducedGeneral)
    assert run.solver.layout.size <= 3 + 1 + 4 * 20
    for b in reference.model.layout:
        want = reference.block(b.name)
        error = np.abs(decoded(run, b.name) - want)[1:].max() / np.abs(want).max()
        assert error < 1e-5, b.name


@pytest.mark.parametrize("reducer", ["full", {
    "use": "galerkin", "basis": {"use": "pod", "count": 5}}], ids=["full", "galerkin"])
def test_the_laws_of_a_reducer(reducer: Any) -> None:
    """Nothing hidden in the solver: pickled memory goes on to the same digits, kept factor and
    all."""
    short = scene(BOTH, steps=6, reducer=reducer)
    check_reducer(short.using({"training": {"end": 6 * STEP, "every": 1}}))


def test_substeps_of_another_size() -> None:
    """Error-controlled steps: each size has its own solver, memory and factor."""
    coarse = scene(["elastic"], steps=6)
    stored = simulate(coarse.using({"time.control": {"tolerance": 0.5}}))
    assert stored.summary["control"]["substeps"] > 6
    forces_on = stored.block("drive.multiplier")[-1, 0]
    assert abs(forces_on + 0.2 * LOAD) < 0.05 * LOAD


def test_facets_far_from_the_contact_are_not_visited() -> None:
    """A plate twice as long has twice the surface; a step visits the slider's facets."""
    visited = []
    for plate in ((18, 4), (36, 4)):
        reference = march(scene(["elastic"], plate=plate, steps=4))
        run = march(scene(["elastic"], plate=plate, steps=4, reducer={
            "use": "galerkin", "basis": {"use": "pod", "count": 3}}),
            model=reference.model, snapshots=learnt(reference))
        visited.append(dict(run.solver.elements_touched))
        assert "sole" in run.solver.notes[-1]
    assert visited[0] == visited[1] == {"slider.elastic": 6, "plate.elastic": 6}


@cache
def pushed(columns: int) -> March:
    """A Galerkin model on a plate of that many facets of one size, pushed by two of them."""
    reference = march(scene(["elastic"], plate=(columns, 4), steps=5))
    few = {"use": "galerkin", "basis": {"use": "pod", "count": 4}}
    return march(scene(["elastic"], plate=(columns, 4), steps=40, reducer=few),
                 model=reference.model, snapshots=learnt(reference))


def followed(run: March) -> tuple[Any, FloatArray, FloatArray]:
    """The contact of a Galerkin run, and its unknowns and rates at all states."""
    (coupled,) = run.solver.equations.coupled  # type: ignore[attr-defined]
    return coupled.term, run.x[:, coupled.columns], run.v[:, coupled.columns]


def facets(term: Any) -> list[int]:
    return [len(side.surface.facets) for side in term.sides]


def test_a_reduced_step_evaluates_the_facets_near_the_contact() -> None:
    """Eight times the plate: as many facets a step, as many searches over a run."""
    counted = []
    for columns in (18, 144):
        run = pushed(columns)
        term, x, _ = followed(run)
        near = term.near(x[10])
        assert facets(term.term) == [6, columns]
        solver: Any = run.solver
        state, memory = solver.start(initial(run))
        integrator = scene(["elastic"]).integrator
        state = integrator.start(solver.layout, state)
        for _ in range(40):
            formula = integrator.formula(solver.layout, state, STEP)
            outcome, memory = solver.solve(formula, memory)
            state = integrator.advance(solver.layout, state, formula, outcome.x, STEP)
        counted.append((facets(near.some.term), memory.counters()["searches"]))
        # 0.15 mm of travel; a new list once a margin
        assert memory.counters()["searches"] <= 2 + 40 * 1.1 * STEP / term.margin
    assert counted[0] == counted[1]
    assert counted[0][0][1] < 18


def initial(run: March) -> Any:
    return consistent_state(run.model)


def test_facets_left_out_cannot_touch() -> None:
    """Wherever the list holds, what it gives is what all facets give; beyond its margin it does not
    hold, nor where a step came from too far."""
    term, x, v = followed(pushed(18))
    rng, near = np.random.default_rng(2), term.near(x[10])
    c1, none = np.full(x.shape[1], 1.0 / STEP), np.zeros(x.shape[1])
    seen = 0
    for size in (1e-6, 1e-5, 1e-4):
        for _ in range(20):
            there = x[10] + size * rng.standard_normal(x.shape[1]) * np.abs(x).max(axis=0) / 1e-4
            if not near.holds(there):
                continue
            seen += 1
            for whole, part in (
                (term.residual(there, v[10], none, 0.0), near.residual(there, v[10], none, 0.0)),
                (term.jacobian(there, v[10], none, 0.0, c1, none),
                 near.jacobian(there, v[10], none, 0.0, c1, none)),
            ):
                assert np.abs(whole - part).max() <= 1e-13 * np.abs(whole).max()
            assert term.doubt(there, v[10], 0.0, STEP) == near.doubt(there, v[10], 0.0, STEP)
    assert seen > 20
    far = x[10] + np.where(np.arange(x.shape[1]) == 0, 1.01 * term.margin, 0.0)
    assert not near.holds(far) and near.holds(x[11])
    assert term.near(x[10] + np.where(np.arange(x.shape[1]) == 1, SIDE, 0.0)).some is None
    reach, down = term.term.reach, np.where(np.arange(x.shape[1]) == 1, 1.0, 0.0)
    deep = x[10] - 1.05 * reach * down
    for share in (0.1, 2.0):  # of half a facet in the step: told by the list, and by all facets
        speed = v[10] - share * reach / STEP * down
        assert near.doubt(deep, speed, 0.0, STEP) == term.doubt(deep, speed, 0.0, STEP) != ""


# --------------------------------------------------------------------------- its history

HISTORIES = {"normal", "friction", "power", "length", "pressure"}


@cache
def trained() -> RunResult:
    return simulate(scene(BOTH, steps=20))


def test_a_run_without_stage_keeps_the_history_of_its_contact() -> None:
    """Fig. 10 of the paper: the same interface as for a rigid stage."""
    run = trained()
    (sole,) = run.contacts().values()
    assert set(sole) == {"time", *HISTORIES} and run.stage() is None
    assert len(sole["time"]) == 21 and np.all(sole["time"] == run.times)
    assert sole["normal"][0] == 0.0 and abs(sole["normal"][-1] - LOAD) < 2e-3 * LOAD
    np.testing.assert_allclose(sole["friction"][1:], 0.2 * sole["normal"][1:], rtol=2e-3)
    assert abs(sole["power"][1:].sum() * STEP - run_heat(run)) < 1e-9 * run_heat(run)
    assert 0.5 * SIDE < sole["length"][-1] <= SIDE * (1 + 1e-3)
    assert sole["pressure"][-1] > sole["normal"][-1] / SIDE / sole["length"][-1]


def run_heat(run: RunResult) -> float:
    """J in both bodies at the end."""
    x = np.concatenate([run.block(b.name, slice(-1, None)) for b in run.layout], axis=1)
    return float(stored(full().model, x)[0])


def test_a_reduced_run_tells_what_it_evaluates(tmp_path: Path) -> None:
    """Galerkin evaluates all that touches; rows that leave facets out cannot tell, and say so."""
    short = scene(BOTH, steps=10).using({"training": {"end": 10 * STEP, "every": 1}})
    galerkin = {"use": "galerkin", "basis": {"use": "pod", "count": 8}}
    run = simulate(short.using({"reducer": galerkin}))
    mine, reference = run.contacts()["sole"], trained().contacts()["sole"]
    for name in HISTORIES:
        want = reference[name][:11]
        assert np.abs(mine[name] - want).max() < 1e-3 * np.abs(want).max(), name
    drawn = write_run_charts(run, tmp_path, formats=["png"])
    assert "contact_forces" in {f.stem for f in drawn}
    some = {"use": "sparse", "basis": {"use": "pod", "count": 4}, "preconditioner": "none",
            "sampler": {"use": "lhs", "required": False},
            "budgets": {"*": {"rows": 5}}}
    elastic = scene(["elastic"], steps=4, slider={"frame": "fixed"}).using({"joints": {}})
    part = march(elastic.using({"reducer": some}), snapshots=learnt(march(elastic)))
    assert part.solver.acting(None) == ()
    assert any("sole: this model evaluates a part" in note for note in part.solver.notes)


def test_forces_that_do_not_settle_are_told() -> None:
    """The foundation swings 2.5 times a step; a rule that hardly damps that goes on for ever."""
    notes = {}
    for rho_inf in (0.5, 0.8):
        rule = {"use": "generalized_alpha", "rho_inf": rho_inf}
        run = simulate(scene([], surfaces="rigid", steps=60).using({"integrator": rule}))
        notes[rho_inf] = [n for n in run.summary["notes"] if "back and forth" in n]
    assert not notes[0.5] and "contact sole" in notes[0.8][0]


# --------------------------------------------------------------------------- heat


def test_friction_heats_both_bodies_by_the_work_of_friction() -> None:
    run = full()
    gained = np.diff(stored(run.model, run.x))
    f, layout = forces(run), run.model.layout
    entering = [f[layout[f"{b}.thermal"]].sum() for b in ("slider", "plate")]
    assert abs(sum(entering) * STEP - gained[-1]) < 1e-9 * gained[-1]
    assert abs(entering[0] - entering[1]) < 1e-9 * entering[0]
    # slip is 1 m/s but for the deformation's own rates
    assert abs(sum(entering) - 0.2 * LOAD) < 0.02 * LOAD


@pytest.mark.parametrize("reducer", ["full", {"use": "galerkin", "basis": {
    "use": "pod", "count": 25}}], ids=["full", "galerkin"])
def test_heat_crosses_the_contact(reducer: Any) -> None:
    """A hot slider at rest on the plate: what it loses the plate has, in both paths."""
    still = {"pose": {"velocity": [0.0, 0.0]}, "initial_temperature": 50.0}
    hot = scene(BOTH, conductance=1e5, slider=still, steps=30)
    hot = hot.using({"joints.drive.x": 0.0, "contacts.sole.friction": None})
    reference = march(hot)
    run = reference if reducer == "full" else march(
        hot.using({"reducer": reducer}), model=reference.model, snapshots=learnt(reference))
    x = np.concatenate([decoded(run, b.name) for b in reference.model.layout], axis=1)
    heat = stored(reference.model, x)
    sliders = reference.model.separated.heat[0]
    lost = float((x[0] - x[-1])[reference.model.layout["slider.thermal"]]
                 @ sliders.capacity.sum(axis=0))
    assert sliders.name == "slider" and lost > 1e-3 * heat[0]
    assert np.abs(heat - heat[0]).max() < 1e-3 * lost
    assert np.abs(x[-1] - reference.x[-1])[reference.model.layout["plate.thermal"]].max() < (
        1e-5 * reference.block("plate.thermal").max())


# --------------------------------------------------------------------------- impact


def falling(speed: float, steps: int) -> Scene:
    """Dropped flat onto the middle of the plate from 0.3 of its height, nothing driving it."""
    start = {"pose": {"position": [SIDE, 0.3 * SIDE], "velocity": [0.0, -speed]}}
    return scene(["elastic"], slider=start, steps=steps).using({"joints": {}})


def test_an_impact_is_solved_and_comes_to_rest() -> None:
    """All facets meet the plate within one step; BDF1 damps what follows."""
    run = march(falling(10.0, 60))
    assert max(run.iterations) <= 20
    assert abs(forces(run)[run.model.layout["slider.rigid"]][1] - LOAD) < 1e-6 * LOAD
    assert np.abs(run.v[-1]).max() < 1e-5


def test_a_step_that_is_too_long_is_told() -> None:
    """1.1 mm a step, through the plate's surface: a status that names the contact."""
    with pytest.raises(SolveFailed, match="contact sole: a point of slider went") as raised:
        march(falling(300.0, 5))
    assert raised.value.status is Status.NOT_CONVERGED and raised.value.time < 2 * STEP
