"""A run in memory: what tests of bodies, joints, loads and integrators look at."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import ReducedProblem, State, StepSolver
from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.scene.source import Source
from sparsemor.core.simulation.offline import Offline, step_count
from sparsemor.core.simulation.time_stepping import FixedStep, accepted_steps, started


@dataclass(frozen=True, slots=True, eq=False)
class March:
    """Kept states of one run: t (s), x, v, a (M, n) in the step solver's layout, M rows."""

    model: Model
    solver: StepSolver
    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    iterations: tuple[int, ...]

    def block(self, name: str) -> FloatArray:
        """(M, k) unknowns of one block."""
        return self.x[:, self.solver.layout[name]]

    @property
    def end(self) -> State:
        """The last state, without the integrator's memory."""
        return State(float(self.t[-1]), self.x[-1], self.v[-1], self.a[-1], np.zeros((0, 0)))


def scene_of(tree: Mapping[str, Any]) -> Scene:
    """A scene from plain data, as a scene file holds it."""
    return build(Source.of_tree({"format": 1, **tree}))


def march(
    scene: Scene, *, every: int = 1, model: Model | None = None,
    snapshots: Mapping[str, FloatArray] | None = None,
) -> March:
    """Run a scene, keeping the start, every so many steps, and the last; nothing is written.

    model: of the same scene, when it is assembled already; snapshots: block -> (n, M), for
    reducers that learn. Raises SolveFailed when the run stops before its end.
    """
    model = assemble(scene) if model is None else model
    h, steps, integrator = scene.time.step, step_count(scene), scene.integrator
    solver: StepSolver = scene.reducer.prepare(ReducedProblem(
        model, integrator, h, Offline.of(model, snapshots or {}),
        np.random.default_rng(scene.seed)))
    state, memory = started(solver, integrator, consistent_state(model))
    kept, iterations = [state], []
    step = FixedStep(integrator, solver, h)
    for n, taken in enumerate(accepted_steps(step, state, memory, steps, h), 1):
        iterations.append(taken.outcome.iterations)
        if n % every == 0 or n == steps:
            kept.append(taken.state)
    t = np.array([s.t for s in kept])
    x, v, a = (np.stack([getattr(s, which) for s in kept]) for which in "xva")
    return March(model, solver, t, x, v, a, tuple(iterations))
