"""Asking first whether an exchange pays does not change a run, and saves nearly all selections."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.assemble import assemble
from sparsemor.core.initial import consistent_state
from sparsemor.core.model import Model
from sparsemor.core.offline import Offline
from sparsemor.core.protocols import SparseOutcome, SparseProblem, SparseStart
from sparsemor.core.scene import Scene, load
from sparsemor.core.testing.run import march
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton
from sparsemor.reducers.sparse_stepper import SparseStepper

BUDGETS = {"*.elastic": {"rows": 80, "atoms": 11}, "*.thermal": {"rows": 40, "atoms": 5}}


class Counted(GreedyGaussNewton):
    """Counts how often it is run."""

    runs: list[int]

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        self.runs.append(len(start.c))
        return super().solve(problem, start)


@cache
def trained(elements: int) -> tuple[Scene, Model, dict[str, FloatArray]]:
    """Snapshots of 1 s: more atoms than the start of the run needs."""
    scene = load("double_pendulum", {
        "bodies.link1.mesh.elements": elements, "bodies.link2.mesh.elements": elements,
        "time.end": 1.0})
    model = assemble(scene)
    full = march(scene.using({"reducer": "full"}), model=model)
    return scene, model, {n: full.block(n).T for n in model.reducible()}


def run(
    elements: int, end: float, solver: Any, **options: Any
) -> tuple[FloatArray, list[dict[str, BoolArray]]]:
    """States (M, n) and supports after each step."""
    scene, model, snapshots = trained(elements)
    scene = scene.using({"reducer": {
        "use": "sparse", "basis": "pod", "bases": {}, "budgets": BUDGETS, **options}})
    reducer = scene.reducer.model_copy(update={"solver": solver})
    stepper = reducer.prepare(model, scene.integrator, scene.time.step,
                              Offline.of(model, snapshots), np.random.default_rng(1))
    assert isinstance(stepper, SparseStepper)
    state, memory = stepper.start(consistent_state(model))
    state = scene.integrator.start(stepper.layout, state)
    x, supports = [], []
    for _ in range(round(end / scene.time.step)):
        formula = scene.integrator.formula(stepper.layout, state, scene.time.step)
        outcome, memory = stepper.solve(formula, memory)
        assert outcome.status.ok, outcome
        state = scene.integrator.advance(
            stepper.layout, state, formula, outcome.x, scene.time.step)
        x.append(state.x)
        supports.append({n: s.copy() for n, s in stepper.supports(memory).items()})
    return np.array(x), supports


def assert_screened_is_the_same(elements: int, end: float, candidates: Any) -> tuple[int, int]:
    """Bit by bit; number of steps that changed a support, and of runs of the solver."""
    asked, never = Counted(candidates=candidates, runs=[]), Counted(
        candidates=candidates, runs=[])
    x, supports = run(elements, end, asked)
    want, own = run(elements, end, never, screen=False)
    for a, b in zip(supports, own, strict=True):
        for name in b:
            np.testing.assert_array_equal(a[name], b[name])
    np.testing.assert_array_equal(x, want)
    assert len(never.runs) >= 3 * len(x), "two blocks of heat and one of mechanics in each step"
    changed = sum(any(not np.array_equal(a[n], b[n]) for n in a)
                  for a, b in zip(supports[1:], supports[:-1], strict=True))
    return changed, len(asked.runs)


@pytest.mark.parametrize("candidates", ["correlated", "all"])
def test_a_screened_run_is_the_same_run(candidates: str) -> None:
    changed, runs = assert_screened_is_the_same(320, 0.2, candidates)
    assert changed >= 8
    assert runs <= 6, "the first support takes three; others only where a decision is too close"


@pytest.mark.slow
@pytest.mark.parametrize("candidates", ["correlated", "all"])
def test_a_screened_run_is_the_same_run_on_the_packaged_mesh(candidates: str) -> None:
    changed, runs = assert_screened_is_the_same(1280, 1.0, candidates)
    assert changed >= 8
    assert runs <= 20


def test_a_solver_without_a_screen_is_run_in_every_step() -> None:
    from sparsemor.plugins.sparse_solvers.omp import OrthogonalMatchingPursuit

    solver = OrthogonalMatchingPursuit()
    x, supports = run(320, 0.02, solver)
    want, own = run(320, 0.02, solver, screen=False)
    np.testing.assert_array_equal(x, want)
    assert all(np.array_equal(a[n], b[n]) for a, b in zip(supports, own, strict=True) for n in a)
