"""Selection among orthonormal atoms by all rows of D^-1 r, where the operator of a block is the
unit matrix: least squares choose rows, and a step evaluates those of its support."""

from typing import Any

import numpy as np
import pytest

from small_scenes import tiny
from sparsemor.core import ReducedProblem
from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.linalg import column_subsets
from sparsemor.core.linalg.column_subsets import ColumnSubsets, is_unit_matrix
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.protocols.integrator import advanced, step_formula
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.testing.in_memory_run import march
from sparsemor.plugins.sparse_solvers import greedy_gauss_newton
from sparsemor.reducers.sparse import supported_equations
from sparsemor.reducers.sparse.supported_steps import SparseStepper

ACTIVE = 5


def scene(kind: str) -> Scene:
    """Five of twelve atoms in both fields; turning: on a frame whose rotation is prescribed."""
    selecting = tiny().using({"reducer": {
        "use": "sparse", "residual": "preconditioned", "basis": {"use": "pod", "count": 12},
        "bases": {}, "budgets": {"*": {"atoms": ACTIVE}}}})
    if kind == "joints":
        return selecting
    return selecting.using({
        "bodies.bar.reference": {"clamp": "left"}, "rigid_stage": {}, "joints": {
            "turn": {"use": "prescribed_motion", "of": "bar:left", "x": 0.0, "y": 0.0,
                     "angle": {"use": "sine", "amplitude": 0.2, "frequency": 20.0}}}})


def steps(kind: str, count: int = 12) -> tuple[FloatArray, list[dict[str, BoolArray]], Any, Any]:
    """States and supports of some steps, the step solver and its memory."""
    chosen = scene(kind)
    model = assemble(chosen)
    run = march(chosen.using({"reducer": "full", "time.end": count * chosen.time.step}),
                model=model)
    solver = chosen.reducer.prepare(ReducedProblem(
        model, chosen.integrator, chosen.time.step,
        Offline.from_snapshots(model, {n: run.block(n).T for n in model.reducible()}),
        np.random.default_rng(1)))
    assert isinstance(solver, SparseStepper)
    state, memory = solver.start(consistent_state(model))
    state, rules = chosen.integrator.start(solver.layout, state), chosen.integrator.rules(
        chosen.time.step)
    x, supports = [], []
    for _ in range(count):
        formula = step_formula(rules, solver.layout, state, chosen.time.step)
        outcome, memory = solver.solve(formula, memory)
        assert outcome.status.ok, outcome
        state = advanced(rules, solver.layout, state, formula, outcome)
        x.append(outcome.x)
        supports.append(dict(memory.supports))
    return np.array(x), supports, solver, memory


@pytest.mark.full
@pytest.mark.parametrize(("kind", "wide"), [("joints", False), ("turning", True)])
def test_chosen_rows_give_what_least_squares_give(
    kind: str, wide: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the columns, and with them the rows, are those of the support alone."""
    monkeypatch.setattr(supported_equations, "WIDE", 4 if wide else 10**6)
    x, supports, solver, memory = steps(kind)
    for module in (column_subsets, greedy_gauss_newton):
        monkeypatch.setattr(module, "is_unit_matrix", lambda A: False)
    monkeypatch.setattr(supported_equations, "WIDE", 10**6)
    expected, expected_supports, other, _ = steps(kind)
    for found, wanted in zip(supports, expected_supports, strict=True):
        assert all((found[n] == wanted[n]).all() for n in wanted)
    for block in solver.layout:
        at = solver.layout[block.name]
        size = np.abs(expected[:, at]).max()
        np.testing.assert_allclose(x[:, at], expected[:, at], atol=1e-9 * size)
    assert {n: s.columns.unit.unit for n, s in solver.steps.elastic.items()} == {
        "bar.elastic": True}
    assert not any(s.columns.unit.unit for s in other.steps.elastic.values())


@pytest.mark.full
def test_a_step_evaluates_the_rows_of_its_support(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not those of all atoms, which are read once, where atoms are selected."""
    monkeypatch.setattr(supported_equations, "WIDE", 4)
    x, supports, solver, memory = steps("turning")
    equations = memory.work.equations
    atoms = solver.dictionaries["bar.elastic"].atoms.shape[1]
    assert equations.rows.rows.rows["bar.elastic"].stop >= atoms > ACTIVE
    rows = equations.restricted.rows["bar.elastic"]
    assert rows.stop - rows.start == supports[-1]["bar.elastic"].sum() <= ACTIVE
    (body,) = equations.restricted.bodies
    assert body.operators.mass.shape[0] == rows.stop - rows.start


def test_subsets_of_the_unit_matrix_need_no_factors() -> None:
    rng, some = np.random.default_rng(0), np.array([True, False, True, False])
    unit, b = ColumnSubsets(np.eye(4), 1e-12), rng.standard_normal(4)
    near = ColumnSubsets(np.eye(4) + 1e-15 * np.tri(4, k=-1), 1e-12)
    assert is_unit_matrix(unit.A) and unit.unit and not near.unit
    assert not is_unit_matrix(np.eye(4)[:3]) and not is_unit_matrix(np.fliplr(np.eye(4)))
    assert unit.independent(some)
    for name in ("solution", "least_norm_solution", "squared_residual"):
        np.testing.assert_allclose(
            getattr(unit, name)(some, b), getattr(near, name)(some, b), atol=1e-14)
    np.testing.assert_allclose(unit.left_inverse(some), near.left_inverse(some), atol=1e-14)
