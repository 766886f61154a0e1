"""Step memory: all that a step writes to is in it, and a copy of it goes on to equal bits."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import random_chains
from reduced_runs import learnt
from small_scenes import tiny
from sparsemor.core import ReducedProblem, State, StepFormula, StepSolver
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.step_solver import AroundSteps
from sparsemor.core.results.checkpoint import Saved
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.step_control import controlled, step_of
from sparsemor.core.simulation.time_stepping import accepted_steps, started
from sparsemor.core.testing.in_memory_run import march
from sparsemor.core.testing.reducer import Run, in_two_threads, two_runs
from springs import bars, coupled
from tiers import quick
from tiny_scene import BUDGETS, FIXED

COUNT = 8
FEW: dict[str, Any] = {"basis": {"use": "pod", "count": 6}}
KINDS = (
    "full",
    "full, textbook Newton",
    "full, many links",
    "full, frames at rest",
    "full, controlled steps",
    "galerkin",
    "galerkin, frames at rest",
    "galerkin, controlled steps",
    "sparse, fixed atoms",
    "sparse, selected atoms",
    "sparse, selected by cosamp",
    "sparse, selected jointly",
    "sparse, sets of rows",
    "sparse, new rows",
    "coupled, full",
    "coupled, galerkin",
)
QUICK = ["full", "galerkin, frames at rest", "sparse, selected atoms"]


@cache
def scenes() -> dict[str, Scene]:
    at_rest = tiny().using({
        "joints": {}, "bodies.bar.frame": "fixed", "bodies.bar.reference": {"clamp": "left"}})
    return {
        "full": tiny().using({"reducer": "full"}),
        "full, textbook Newton": tiny().using({"reducer": {"use": "full", "method": "newton"}}),
        "full, many links": random_chains.scene(
            random_chains.chain(np.random.default_rng(3), 11, rigid=True)),
        "full, frames at rest": at_rest.using({"reducer": "full"}),
        "full, controlled steps": tiny().using({
            "reducer": "full", "time.control": {"tolerance": 0.1}}),
        "galerkin": tiny().using({"reducer": {"use": "galerkin", **FEW}}),
        "galerkin, frames at rest": at_rest.using({"reducer": {"use": "galerkin", **FEW}}),
        "galerkin, controlled steps": tiny().using({
            "reducer": {"use": "galerkin", **FEW}, "time.control": {"tolerance": 0.1}}),
        "sparse, fixed atoms": tiny().using({"reducer": {
            "use": "sparse", **FEW, "budgets": FIXED}}),
        "sparse, selected atoms": tiny().using({"reducer": {
            "use": "sparse", **FEW, "budgets": BUDGETS}}),
        "sparse, selected by cosamp": tiny().using({"reducer": {
            "use": "sparse", **FEW, "budgets": BUDGETS, "solver": "cosamp"}}),
        "sparse, selected jointly": tiny().using({"reducer": {
            "use": "sparse", **FEW, "budgets": BUDGETS, "selection": "joint"}}),
        "sparse, sets of rows": tiny().using({"reducer": {
            "use": "sparse", **FEW, "budgets": BUDGETS, "resample": 2, "row_sets": 2}}),
        "sparse, new rows": tiny().using({"reducer": {
            "use": "sparse", **FEW, "budgets": BUDGETS, "resample": 2}}),
        "coupled, full": bars(reducer="full"),
        "coupled, galerkin": bars(reducer={"use": "galerkin", **FEW}),
    }


@cache
def learned(kind: str) -> tuple[Model, dict[str, FloatArray]]:
    """The model of a scene, and the snapshots of its first steps at full order."""
    scene = scenes()[kind]
    model = coupled(scene) if kind.startswith("coupled") else None
    run = march(scene.using({"reducer": "full", "time.end": 20 * scene.time.step}), model=model)
    return run.model, learnt(run)


def prepared(kind: str) -> tuple[Scene, Model, StepSolver]:
    scene, (model, snapshots) = scenes()[kind], learned(kind)
    offline = Offline.from_snapshots(model, snapshots)
    solver: StepSolver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, offline, np.random.default_rng(scene.seed)))
    return scene, model, controlled(scene, model, offline, solver)


def steps(
    scene: Scene, solver: StepSolver, state: State, memory: Any, count: int
) -> tuple[FloatArray, State, Any]:
    """(count, n) x, and state and memory after the last."""
    h = scene.time.step
    step = step_of(solver, scene.integrator, h)
    taken = list(accepted_steps(step, state, memory, count, h))
    return np.array([one.state.x for one in taken]), taken[-1].state, taken[-1].memory


@dataclass(frozen=True, eq=False)
class SharedScratch(AroundSteps[Any]):
    """A step solver with the fault that the law is for: an array that every step writes to."""

    free: FloatArray

    def start(self, state: State) -> Any:
        return self.base.start(state)

    def solve(self, step: StepFormula, memory: Any) -> Any:
        self.free[:] = step.free
        return self.base.solve(replace(step, free=self.free), memory)


def runs(scene: Scene, model: Model, solver: Any) -> tuple[Run, Run]:
    """Two runs of one solver, some steps apart."""
    begin = started(solver, scene.integrator, consistent_state(model))
    return two_runs(step_of(solver, scene.integrator, scene.time.step), *begin, COUNT // 4)


@pytest.mark.full
@pytest.mark.parametrize("kind", KINDS)
def test_one_solver_serves_two_threads(kind: str) -> None:
    """Threads that are some steps apart, and change at the calls of functions."""
    one, other = runs(*prepared(kind))
    alone = one(), other()
    assert np.ptp(alone[0], axis=0).max() > 0.0
    assert not np.array_equal(*alone)
    for found, expected in zip(in_two_threads(one, other), alone, strict=True):
        assert np.array_equal(found, expected)


@pytest.mark.parametrize("kind", quick(["full", "galerkin", "coupled, galerkin"], "full"))
def test_a_solver_that_writes_to_itself_is_caught(kind: str) -> None:
    """In one thread its runs are right, also step by step in turns."""
    scene, model, solver = prepared(kind)
    one, other = runs(scene, model, SharedScratch(solver, np.zeros(solver.layout.size)))
    alone = one(), other()
    assert all(np.array_equal(*pair) for pair in zip(
        alone, (run() for run in runs(scene, model, solver)), strict=True))
    assert not all(np.array_equal(*pair) for pair in zip(
        in_two_threads(one, other), alone, strict=True))


@pytest.mark.parametrize("kind", quick(KINDS, *QUICK))
def test_a_copy_goes_on_to_equal_bits(kind: str) -> None:
    """The copy first, then one that was stored, then the original: steps of the one do not show in
    the other."""
    scene, model, solver = prepared(kind)
    begin = started(solver, scene.integrator, consistent_state(model))
    _, state, memory = steps(scene, solver, *begin, COUNT // 4)
    other, stored = memory.copy(), Saved.load(Saved.from_value(memory).dump()).into(
        solver.start(consistent_state(model))[1])
    ahead = steps(scene, solver, state, other, COUNT)[0]
    assert np.array_equal(steps(scene, solver, state, stored, COUNT)[0], ahead)
    assert np.array_equal(steps(scene, solver, state, memory, COUNT)[0], ahead)
    assert not np.array_equal(ahead[0], ahead[-1])
