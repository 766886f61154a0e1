"""Run of a scene in memory, for tests of bodies, joints, loads and integrators."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.reducer import ReducedProblem
from sparsemor.core.protocols.step_solver import StepSolver
from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.scene.source import Source
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.time_stepping import FixedStep, accepted_steps, started


@dataclass(frozen=True, slots=True, eq=False)
class March:
    """States of one run at M times: t (M,), s, and x, v, a (M, n) in the step solver's layout;
    iterations: those of each step."""

    model: Model
    solver: StepSolver
    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    iterations: tuple[int, ...]

    def block(self, name: str) -> FloatArray:
        """Unknowns (M, k) of one block."""
        return self.x[:, self.solver.layout[name]]

    @property
    def end(self) -> State:
        """Last state, without the integrator's memory."""
        return State(float(self.t[-1]), self.x[-1], self.v[-1], self.a[-1], np.zeros((0, 0)))


def scene_of(tree: Mapping[str, Any]) -> Scene:
    """Scene from plain data, as a scene file contains it."""
    return build(Source.of_tree({"format": 1, **tree}))


def reduced_problem(
    scene: Scene, model: Model, snapshots: Mapping[str, FloatArray]
) -> ReducedProblem:
    """Problem from which a reducer prepares a step solver; snapshots: block -> (n, M) of a training
    run, empty where it needs none."""
    return ReducedProblem(
        model, scene.integrator, scene.time.step, Offline.from_snapshots(model, snapshots),
        np.random.default_rng(scene.seed))


def march(
    scene: Scene, *, every: int = 1, model: Model | None = None,
    snapshots: Mapping[str, FloatArray] | None = None, solver: StepSolver | None = None,
) -> March:
    """Runs a scene and keeps the initial state, every `every`-th state and the last; nothing is
    written.

    model: assembled model of the scene, if there is one; snapshots: block -> (n, M), for reducers
    that need training; solver: prepared step solver of the scene, if there is one. Raises
    SolveFailed when the run stops before its end.
    """
    model = assemble(scene) if model is None else model
    h, steps, integrator = scene.time.step, step_count(scene), scene.integrator
    if solver is None:
        solver = scene.reducer.prepare(reduced_problem(scene, model, snapshots or {}))
    state, memory = started(solver, integrator, consistent_state(model))
    kept, iterations = [state], []
    step = FixedStep.of(integrator, solver, h)
    for n, taken in enumerate(accepted_steps(step, state, memory, steps, h), 1):
        iterations.append(taken.outcome.iterations)
        if n % every == 0 or n == steps:
            kept.append(taken.state)
    t = np.array([s.t for s in kept])
    x, v, a = (np.stack([getattr(s, which) for s in kept]) for which in "xva")
    return March(model, solver, t, x, v, a, tuple(iterations))
