"""What the sparse reducer refuses, preconditions and tells."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from small_scenes import everything, tiny
from sparsemor.core import ReducedProblem, Selection, SparseOutcome, StepOutcome
from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.linalg.dense import coherence, condition_number, unit_columns
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.protocols.integrator import step_formula
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.status import Status
from sparsemor.core.testing.in_memory_run import march
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton
from sparsemor.reducers.sparse.reducer import Sparse
from sparsemor.reducers.step import projected_operators as test_map
from tiny_scene import BUDGETS, FIXED, full, prepared, snapshots

WIDE = {"*.elastic": {"rows": 8, "atoms": 6}, "*.thermal": {"rows": 4, "atoms": 3}}
"""With the required ones fewer rows than atoms, as UNTF and Parseval frames ask."""


def reduced(**options: Any) -> Scene:
    """Sampled rows of r: preconditioners and facts are those of plain rows."""
    return tiny().using({"reducer": {
        "use": "sparse", "residual": "plain", "basis": {"use": "pod", "count": 14},
        "budgets": FIXED,
        "bases": {"*.thermal": {"use": "pod", "count": 8}}, **options}})


# ------------------------------------------------------------------------ refusals


class Linear(GreedyGaussNewton):
    """A solver that says it can do linear problems without free columns only."""

    @property
    def capabilities(self) -> frozenset[str]:
        return frozenset({"overdetermined", "underdetermined"})


class Square(Linear):
    @property
    def capabilities(self) -> frozenset[str]:
        return frozenset()


def with_solver(scene: Scene, solver: Any) -> Sparse:
    reducer = scene.reducer.model_copy(update={"solver": solver})
    assert isinstance(reducer, Sparse)
    return reducer


def test_a_solver_that_lacks_a_capability_is_refused_before_training() -> None:
    model = full().model
    (fault,) = with_solver(reduced(budgets=BUDGETS, selection="joint"), Linear()).check(model)
    assert fault.key == "solver"
    assert fault.message.startswith("Linear cannot solve bar.elastic, which needs nonlinear: ")
    assert "unpenalised: columns that are always active" in fault.message
    # block by block every problem is linear and all its columns are penalised
    assert not with_solver(reduced(budgets=BUDGETS), Linear()).check(model)
    faults = with_solver(reduced(budgets=BUDGETS), Square()).check(model)
    assert [f.key for f in faults] == ["solver", "solver"]
    assert any("bar.thermal, which needs overdetermined" in f.message for f in faults)
    assert not with_solver(reduced(budgets=BUDGETS), GreedyGaussNewton()).check(model)
    # nothing is selected: the solver is not asked anything
    assert not with_solver(reduced(), Square()).check(model)


def test_what_only_the_dictionary_shows_is_refused_when_it_is_made() -> None:
    scene = reduced(budgets=BUDGETS, basis="pod", bases={"*.elastic": {"use": "pod", "count": 4}})
    reducer = with_solver(scene, Square())
    assert not reducer.check(full().model)
    with pytest.raises(InputError, match="Square cannot solve bar.thermal, which needs over"):
        reducer.prepare(ReducedProblem(
            full().model, scene.integrator, scene.time.step, Offline.from_snapshots(full().model,
            snapshots()), np.random.default_rng(0)))


@pytest.mark.parametrize(("options", "key", "words"), [
    ({"row_sets": 3}, "row_sets", "rows are drawn only once"),
    ({"preconditioned": ["elastc"]}, "preconditioned.*.elastc", "fits no block"),
])
def test_bad_options_are_told_by_key(options: dict[str, Any], key: str, words: str) -> None:
    faults = reduced(**options).reducer.check(full().model)
    assert [f.key for f in faults] == [key] and words in faults[0].message


@pytest.mark.full
def test_new_rows_of_radiation_need_a_number_of_sets() -> None:
    model = assemble(everything())
    budgets = {"*.elastic": {"rows": 8}, "*.thermal": {"rows": 0}}
    faults = Sparse.model_validate({"budgets": budgets, "resample": 2}).check(model)
    assert [f.key for f in faults] == ["row_sets"] and "radiation" in faults[0].message
    assert not Sparse.model_validate(
        {"budgets": budgets, "resample": 2, "row_sets": 2}).check(model)


# ------------------------------------------------------------------------ preconditioning, facts


def test_facts_tell_coherence_and_condition_before_and_after() -> None:
    plain = prepared(reduced())
    both = prepared(reduced(preconditioner="row_scaling", preconditioned=["elastic", "*.thermal"]))
    published = prepared(reduced(preconditioner="row_scaling"))
    for name in full().model.reducible():
        facts = plain.facts[name]
        assert set(facts) == {"norm", "rows", "atoms", "coherence", "condition"}
        assert facts["rows"] == len(plain.rows[name])
        assert facts["atoms"] == plain.dictionaries[name].atoms.shape[1]
        after = both.facts[name]
        assert {k: after[k] for k in facts} == facts
        assert 0.0 <= float(after["coherence_after"]) <= 1.0
        assert float(after["condition_after"]) >= 1.0
    assert "condition_after" in published.facts["bar.thermal"]
    assert "condition_after" not in published.facts["bar.elastic"], "as published"


def test_facts_are_those_of_the_rows() -> None:
    scene, solver = reduced(), prepared(reduced())
    model, name = full().model, "bar.thermal"
    (body,) = model.separated.heat
    c1 = 1.0 / scene.time.step
    B = (body.conductivity + c1 * body.capacity) @ solver.dictionaries[name].atoms
    B = B[solver.rows[name]]
    assert solver.facts[name]["coherence"] == pytest.approx(coherence(B), rel=1e-9)
    assert solver.facts[name]["condition"] == pytest.approx(
        condition_number(unit_columns(B)), rel=1e-6)


@pytest.mark.parametrize("preconditioner", ["untf", "parseval"])
def test_frames_tighten_elastic_rows(preconditioner: str) -> None:
    """Fewer rows than atoms: the columns of P B come nearer to a tight frame of unit length."""
    facts = prepared(reduced(budgets=WIDE, preconditioner=preconditioner,
                             preconditioned=["elastic", "thermal"])).facts["bar.elastic"]
    assert facts["rows"] == 12 and facts["atoms"] == 14
    assert float(facts["coherence_after"]) < float(facts["coherence"])
    assert float(facts["condition_after"]) < 0.5 * float(facts["condition"])


@pytest.mark.parametrize("budgets", [FIXED, BUDGETS], ids=["fixed", "selecting"])
def test_preconditioned_runs_stay_near_full_order(budgets: dict[str, Any]) -> None:
    """A nonsingular P changes the weights of the rows, not the equations."""
    scene = reduced(budgets=budgets, preconditioner="row_scaling",
                    preconditioned=["elastic", "thermal"], solver={
                        "use": "greedy_gauss_newton", "candidates": "all"})
    run = march(scene, model=full().model, snapshots=snapshots())
    bound = 1e-5 if budgets is FIXED else 5e-2
    for name in full().model.reducible():
        d, want = run.solver.dictionaries[name], full().block(name)
        got = d.offset + run.block(name) @ d.atoms.T
        size = np.abs(want - want[0]).max()
        assert np.abs(got - want)[1:].max() < bound * size, name


# ------------------------------------------------------------------------ few turned rows


def elastic() -> tuple[test_map.ProjectedElastic, FloatArray, IntArray]:
    (m,) = full().model.separated.moving
    d = prepared(reduced()).dictionaries
    rows = np.arange(3, 51, 2)
    assert m.operators is not None
    t = test_map.ProjectedElastic.from_operators(
        m.operators, m.frame, d["bar.elastic"], d["bar.thermal"],
                         test_map.TestMap(rows=rows))
    return t, t.block(1e3, 1e6), rows


class Failing(GreedyGaussNewton):
    """Never ends."""

    def prepare(self, columns: Any, budget: int) -> Any:
        return Unending()

    def solve(self, problem: Any, start: Any) -> SparseOutcome:
        return replace(super().solve(problem, start), status=Status.NOT_CONVERGED)


class Unending:
    def select(self, r: FloatArray, c: FloatArray, support: BoolArray) -> Selection:
        return Selection(support, Status.NOT_CONVERGED)


class Unfit(GreedyGaussNewton):
    """Prepares nothing that could select."""

    def prepare(self, columns: Any, budget: int) -> Any:
        return columns


def stepped(scene: Scene, solver: Any) -> StepOutcome:
    """First step of a run with another sparse solver."""
    made = with_solver(scene, solver).prepare(ReducedProblem(
        full().model, scene.integrator, scene.time.step, Offline.from_snapshots(
            full().model, snapshots()),
        np.random.default_rng(0)))
    state, memory = made.start(consistent_state(full().model))
    state = scene.integrator.start(made.layout, state)
    rules, h = scene.integrator.rules(scene.time.step), scene.time.step
    return made.solve(step_formula(rules, made.layout, state, h), memory)[0]


@pytest.mark.parametrize("selection", ["blocks", "joint"])
def test_a_selection_that_fails_stops_the_step_and_names_its_block(selection: str) -> None:
    outcome = stepped(reduced(budgets=BUDGETS, selection=selection), Failing())
    assert outcome.status is Status.NOT_CONVERGED and outcome.block == "bar.thermal"
    assert "selection of atoms" in outcome.detail


def test_a_recovery_that_cannot_select_is_named_with_its_solver() -> None:
    with pytest.raises(InputError, match="Unfit.prepare returned a ColumnSubsets, where a "
                                         "Recovery is required"):
        stepped(reduced(budgets=BUDGETS), Unfit())
