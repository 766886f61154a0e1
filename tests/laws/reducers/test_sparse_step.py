"""The sparse method on one page (reducers/sparse/step.py) is what every faster path computes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor.core import ReducedProblem, StepFactors
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.protocols.integrator import step_formula
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.core.simulation.time_stepping import FixedStep, started
from sparsemor.reducers.sparse.reducer import Sparse
from sparsemor.reducers.sparse.residual_rows import inverted_blocks, samplers
from sparsemor.reducers.sparse.sparse_options import Budget
from sparsemor.reducers.sparse.step import SampledRows, SparseStep
from sparsemor.reducers.trial_bases import trial_bases
from tiers import full

SCENES = Path(__file__).parents[2] / "scenes"
FEW = {"*.elastic": {"rows": 16, "atoms": 5}, "*.thermal": {"rows": 12, "atoms": 4}}
ALL = {"*.elastic": {"rows": 16}, "*.thermal": {"rows": 12}}
HOT = {"loads.heating": {"use": "radiation", "on": ["bar:right"], "emissivity": 0.9,
                         "surroundings": 900.0}}


def page(problem: ReducedProblem, reducer: Sparse) -> SparseStep:
    model, h = problem.model, problem.step
    factors = StepFactors(h, *problem.integrator.rules(h).factors)
    atoms = trial_bases(problem.offline, model, reducer, factors).dictionaries
    inverted, drawn = inverted_blocks(model, reducer), samplers(model, reducer)
    blocks = {}
    for name, rng in zip(atoms, problem.rng.spawn(len(atoms)), strict=True):
        budget = matched_option(name, reducer.budgets, Budget())
        weighted = matched_option(name, dict.fromkeys(reducer.preconditioned, True), False)
        blocks[name] = SampledRows(
            model, name, atoms[name], factors, drawn[name],
            reducer.preconditioner if weighted else None, reducer.solver, budget.rows,
            budget.atoms or atoms[name].atoms.shape[1], name in inverted, rng)
    hot = {b.thermal for b in model.separated.heat}
    return SparseStep(
        model, atoms, [b for n, b in blocks.items() if n in hot],
        [b for n, b in blocks.items() if n not in hot], reducer.least_gain(not inverted))


@pytest.mark.parametrize("options, changes", [
    full({"budgets": ALL}, {}),
    full({"budgets": ALL, "residual": "plain"}, {"integrator": "bdf2"}),
    full({"budgets": ALL, "preconditioner": "untf"}, {"integrator": "generalized_alpha"}),
    ({"budgets": FEW}, {}),
    full({"budgets": FEW, "residual": "plain", "hysteresis": 0.0, "preconditioner": "untf"}, {}),
    full({"budgets": FEW, "solver": "omp"}, {"integrator": "bdf2"}),
    full({"budgets": ALL}, HOT),
    full({}, {}),
    full({"budgets": {n: {"atoms": b["atoms"]} for n, b in FEW.items()}}, {}),
    full({"budgets": FEW}, HOT),
], ids=["all", "plain", "untf", "selection", "plain_selection", "omp", "radiation",
        "all_rows", "all_rows_selection", "selection_radiation"])
def test_steps_are_those_of_the_page(options: dict[str, Any], changes: dict[str, Any]) -> None:
    reducer = {"use": "sparse", "basis": {"use": "pod", "count": 10},
               "bases": {"*.thermal": {"use": "pod", "count": 8}}, **options}
    compared(tiny().using({"time.end": 0.01, "training": {"end": 0.04}, "reducer": reducer,
                           **changes}), 6)


SPARSE = {"use": "sparse", "basis": {"use": "pod", "count": 10}}


@pytest.mark.full
@pytest.mark.parametrize("budgets", [ALL, FEW], ids=["all", "selection"])
@pytest.mark.parametrize(("name", "changes"), [
    ("small_slider", {}), ("swing", {}), ("heated_disk", {
        "bodies.disk.mesh": {"use": "disk", "triangles": 300, "rim": 36, "layers": 2}}),
    pytest.param("heated_disk", {}, marks=pytest.mark.slow)],
    ids=["small_slider", "swing", "coarse_disk", "heated_disk"])
def test_steps_of_moving_bodies_are_those_of_the_page(
    name: str, changes: dict[str, Any], budgets: dict[str, Any]
) -> None:
    """A block that slides over a plate, two bodies and their joint, a disk in space."""
    reducer = {**SPARSE, "budgets": budgets}
    compared(load(SCENES / f"{name}.yaml", {"reducer": reducer, **changes}), 4)


def compared(scene: Scene, steps: int) -> None:
    """Each step of a run begins at the same state, by the product and by the page."""
    model, offline = prepared(scene, Cache(), new_manager())
    reducer, h = scene.reducer, scene.time.step
    assert isinstance(reducer, Sparse)
    product, own = (ReducedProblem(model, scene.integrator, h, offline, np.random.default_rng(
        scene.seed)) for _ in range(2))
    solver, reference = reducer.prepare(product), page(own, reducer)
    state, memory = started(solver, scene.integrator, consistent_state(model))
    step = FixedStep.of(scene.integrator, solver, h)
    supports = {b.name: np.ones(len(b.lengths), np.bool_)
                for b in (*reference.thermal, *reference.elastic)}
    for _ in range(steps):
        formula = step_formula(scene.integrator.rules(h), solver.layout, state, h)
        outcome, state, memory = step(state, memory)
        assert outcome.status.ok, outcome
        z, supports = reference.step(formula, state.x.copy(), supports)
        selected = solver.supports(memory)
        assert len(selected) == sum(
            matched_option(n, reducer.budgets, Budget()).atoms is not None for n in supports)
        for name, active in selected.items():
            np.testing.assert_array_equal(supports[name], active, err_msg=name)
        for b in solver.layout:
            at = solver.layout[b.name]
            size = max(float(np.abs(z[at]).max()), 1e-12)
            np.testing.assert_allclose(state.x[at], z[at], rtol=0, atol=1e-9 * size,
                                       err_msg=b.name)
