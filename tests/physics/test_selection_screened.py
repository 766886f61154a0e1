"""Asking first whether an exchange pays does not change a run, and saves nearly all selections."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from sparsemor.core import ReducedProblem
from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import (
    SparseOutcome,
    SparseProblem,
    SparseStart,
)
from sparsemor.core.protocols.integrator import step_formula
from sparsemor.core.protocols.step_solver import advanced
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.testing.in_memory_run import march
from sparsemor.plugins.sparse_solvers.greedy_gauss_newton import GreedyGaussNewton
from sparsemor.reducers.sparse.condensed_rows import Eliminated
from sparsemor.reducers.sparse.elastic_screen import ROUGH, RowsAtSolution
from sparsemor.reducers.sparse.joint_problem import MechanicsProblem
from sparsemor.reducers.sparse.stepper import SparseStepper

pytestmark = pytest.mark.full

BUDGETS = {"*.elastic": {"rows": 80, "atoms": 11}, "*.thermal": {"rows": 40, "atoms": 5}}
PUBLISHED = {"*.elastic": {"rows": 240, "atoms": 15}, "*.thermal": {"rows": 80, "atoms": 10}}


class Counted(GreedyGaussNewton):
    """Counts how often it is run."""

    runs: list[int]

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        self.runs.append(len(start.c))
        return super().solve(problem, start)


@cache
def trained(elements: int, end: float = 1.0) -> tuple[Scene, Model, dict[str, FloatArray]]:
    """Snapshots of 1 s: more atoms than the start of the run needs."""
    scene = load("double_pendulum", {
        "bodies.link1.mesh.elements": elements, "bodies.link2.mesh.elements": elements,
        "time.end": end})
    model = assemble(scene)
    full = march(scene.using({"reducer": "full"}), model=model)
    return scene, model, {n: full.block(n).T for n in model.reducible()}


def prepared(
    elements: int, solver: Any, length: float = 1.0, seed: int = 1, **options: Any
) -> tuple[Scene, Model, SparseStepper]:
    """length: of the training, s; seed: of the rows."""
    scene, model, snapshots = trained(elements, length)
    scene = scene.using({"reducer": {
        "use": "sparse", "basis": "pod", "bases": {}, "budgets": BUDGETS, **options}})
    reducer = scene.reducer.model_copy(update={"solver": solver})
    stepper = reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, Offline.of(model, snapshots),
        np.random.default_rng(seed)))
    assert isinstance(stepper, SparseStepper)
    return scene, model, stepper


def run(
    elements: int, end: float, solver: Any, **options: Any
) -> tuple[FloatArray, list[dict[str, BoolArray]]]:
    """States (M, n) and supports after each step."""
    scene, model, stepper = prepared(elements, solver, **options)
    state, memory = stepper.start(consistent_state(model))
    state = scene.integrator.start(stepper.layout, state)
    x, supports = [], []
    for _ in range(round(end / scene.time.step)):
        rules, h = scene.integrator.rules(scene.time.step), scene.time.step
        formula = step_formula(rules, stepper.layout, state, h)
        outcome, memory = stepper.solve(formula, memory)
        assert outcome.status.ok, outcome
        state = advanced(rules, stepper.layout, state, formula, outcome)
        x.append(state.x)
        supports.append({n: s.copy() for n, s in stepper.supports(memory).items()})
    return np.array(x), supports


def assert_screened_is_the_same(
    elements: int, end: float, candidates: Any, hysteresis: float, **options: Any
) -> tuple[int, int]:
    """Bit by bit; number of steps that changed a support, and of runs of the solver."""
    asked, never = (Counted(candidates=candidates, hysteresis=hysteresis, runs=[])
                    for _ in range(2))
    x, supports = run(elements, end, asked, **options)
    want, own = run(elements, end, never, screen=False, **options)
    for a, b in zip(supports, own, strict=True):
        for name in b:
            np.testing.assert_array_equal(a[name], b[name])
    np.testing.assert_array_equal(x, want)
    assert len(never.runs) >= 3 * len(x), "two blocks of heat and one of mechanics in each step"
    changed = sum(any(not np.array_equal(a[n], b[n]) for n in a)
                  for a, b in zip(supports[1:], supports[:-1], strict=True))
    return changed, len(asked.runs)


RULES = [("correlated", 0.0), ("all", 0.0), ("correlated", 0.3), ("all", 0.3)]
"""Candidates and hysteresis: as published, and by default, first and last."""


@pytest.mark.parametrize(("candidates", "hysteresis"), [
    pytest.param(*rule, marks=[pytest.mark.slow] * (rule in RULES[1:3])) for rule in RULES])
def test_a_screened_run_is_the_same_run(candidates: str, hysteresis: float) -> None:
    changed, runs = assert_screened_is_the_same(
        320, 0.4 if hysteresis else 0.2, candidates, hysteresis)
    assert changed >= (3 if hysteresis else 8)
    assert runs <= 6, "the first support takes three; others only where a decision is too close"


@pytest.mark.slow
@pytest.mark.parametrize(("candidates", "hysteresis"), [RULES[0], RULES[-1]])
def test_a_screened_run_is_the_same_run_on_the_packaged_mesh(
    candidates: str, hysteresis: float
) -> None:
    changed, runs = assert_screened_is_the_same(1280, 1.0, candidates, hysteresis)
    assert changed >= (3 if hysteresis else 8)
    assert runs <= 20


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("candidates", "hysteresis"), [RULES[0], RULES[1], RULES[-1]])
def test_no_decision_of_the_packaged_scene_differs(
    candidates: str, hysteresis: float, seed: int, request: pytest.FixtureRequest
) -> None:
    """4 s with the budgets of docs/selection.md. Of one of the nine runs that is not true."""
    if (candidates, hysteresis, seed) == ("all", 0.3, 2):
        request.applymarker(pytest.mark.xfail(strict=False, reason=(
            "two supports are nearly equal in one step, and the screen takes the other one: "
            "docs/selection.md")))
    changed, runs = assert_screened_is_the_same(
        1280, 4.0, candidates, hysteresis, length=4.0, seed=seed, budgets=PUBLISHED)
    assert changed >= 8
    assert runs <= 50


@pytest.mark.parametrize("still", [False, True])
def test_the_border_is_eliminated(still: bool) -> None:
    """Gram matrix and slope of the screen against the joint problem's Jacobian, whose border
    columns are projected out; with and without the screen's two simplifications."""
    scene, model, stepper = prepared(320, GreedyGaussNewton(candidates="all"))
    state, memory = stepper.start(consistent_state(model))
    state = scene.integrator.start(stepper.layout, state)
    for _ in range(3 if still else 60):
        rules, h = scene.integrator.rules(scene.time.step), scene.time.step
        formula = step_formula(rules, stepper.layout, state, h)
        outcome, memory = stepper.solve(formula, memory)
        state = advanced(rules, stepper.layout, state, formula, outcome)
    rules, h = scene.integrator.rules(scene.time.step), scene.time.step
    formula = step_formula(rules, stepper.layout, state, h)
    now, screens = memory.current, stepper.screens_of(memory)
    assert now is not None and now.mechanics is not None and screens is not None
    x, screen = now.tried(formula, memory).x, screens.elastic
    assert screen is not None
    new = Eliminated.of(now.mechanics, memory.work, screen.still)
    assert new is not None
    at = RowsAtSolution(screen, formula, x, now.mechanics, memory.work).around(new, ROUGH)

    blocks = [stepper.elastic[b.elastic_name] for b in now.mechanics.bodies]
    joint = MechanicsProblem(now.mechanics, blocks, formula, x)
    c = joint.start()
    r, J = joint.residual(c), joint.jacobian(c)
    norms = np.linalg.norm(J, axis=0)
    # the step leaves the derivatives of its last iterate, not of its solution
    np.testing.assert_allclose(
        at.lengths * at.c, norms[: joint.k] * c[: joint.k], rtol=1e-5, atol=1e-12)
    square, hidden = at.left()
    assert square == pytest.approx(r @ r, rel=1e-6)
    assert hidden == pytest.approx(((norms * c)[joint.k :] ** 2).sum(), rel=1e-6)
    Q = np.linalg.qr(J[:, joint.k :] / norms[joint.k :])[0]
    own = J[:, : joint.k] / screen.still.lengths
    own = own - Q @ (Q.T @ own)
    G, b = own.T @ own, own.T @ r
    assert at.exact is not None
    for near, gram, slope in ((at, 1e-6, 1e-4), (at.exact(), 1e-9, 1e-6)):
        np.testing.assert_allclose(np.triu(near.gram), np.triu(G), atol=gram)
        np.testing.assert_allclose(near.slope, b, atol=slope * np.abs(b).max())


def test_a_solver_without_a_screen_is_run_in_every_step() -> None:
    from sparsemor.plugins.sparse_solvers.omp import OrthogonalMatchingPursuit

    solver = OrthogonalMatchingPursuit()
    x, supports = run(320, 0.02, solver)
    want, own = run(320, 0.02, solver, screen=False)
    np.testing.assert_array_equal(x, want)
    assert all(np.array_equal(a[n], b[n]) for a, b in zip(supports, own, strict=True) for n in a)
