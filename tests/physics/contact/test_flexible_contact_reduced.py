"""Contact inside the step of reduced models: what they evaluate, and the history they keep."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pressed_slider import BOTH, LOAD, SIDE, STEP, full, scene, stored
from reduced_runs import decoded, learnt
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.core.testing.reducer import check_reducer
from sparsemor.plugins.charts import write_run_charts
from sparsemor.reducers.step.coupled_reduced import ReducedGeneral

pytestmark = pytest.mark.full

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
    """Nothing hidden in the solver: a copy of the memory, and one that was stored, go on to the
    same digits, kept factor and all."""
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
        assert "sole" in run.solver.notes[-1].text
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
    solver: Any = run.solver
    (coupled,) = solver.equations.coupled
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
        assert facets(term.term.term) == [6, columns]
        solver: Any = run.solver
        state, memory = solver.start(initial(run))
        integrator = scene(["elastic"]).integrator
        state = integrator.start(solver.layout, state)
        for _ in range(40):
            formula = step_formula(integrator.rules(STEP), solver.layout, state, STEP)
            outcome, memory = solver.solve(formula, memory)
            state = advanced(
                integrator.rules(STEP), solver.layout, state, formula, outcome)
        counted.append((facets(near.some.term), memory.searches))
        # 0.15 mm of travel; a new list once a margin
        assert memory.searches <= 2 + 40 * 1.1 * STEP / term.margin
    assert counted[0] == counted[1]
    assert counted[0][0][1] < 18


def initial(run: March) -> Any:
    return consistent_state(run.model)


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
    some = {"use": "sparse", "basis": {"use": "pod", "count": 2}, "preconditioner": "none",
            "sampler": {"use": "lhs", "required": False}, "residual": "plain",
            "budgets": {"*": {"rows": 5}}}
    elastic = scene(["elastic"], steps=4, slider={"frame": "fixed"}).using({"joints": {}})
    part = march(elastic.using({"reducer": some}), snapshots=learnt(march(elastic)))
    assert part.solver.resultant_sources(None) == ()
    assert any("sole: this model evaluates a part" in note.text for note in part.solver.notes)


def test_forces_that_do_not_settle_are_told() -> None:
    """The foundation swings 2.5 times a step; a rule that hardly damps that goes on for ever."""
    notes = {}
    for rho_inf in (0.5, 0.8):
        rule = {"use": "generalized_alpha", "rho_inf": rho_inf}
        run = simulate(scene([], surfaces="rigid", steps=60).using({"integrator": rule}))
        notes[rho_inf] = [n for n in run.summary["notes"] if "back and forth" in n]
    assert not notes[0.5] and "contact sole" in notes[0.8][0]
