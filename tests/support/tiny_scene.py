"""The scene tests/scenes/tiny.yaml, its full-order run, and reducers prepared on that run."""

from functools import cache

import numpy as np

from small_scenes import tiny
from sparsemor.core import ReducedProblem, StepSolver
from sparsemor.core.arrays import FloatArray
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.testing.in_memory_run import March, march

BUDGETS = {"*.elastic": {"rows": 14, "atoms": 4}, "*.thermal": {"rows": 10, "atoms": 3}}
FIXED = {"*.elastic": {"rows": 14}, "*.thermal": {"rows": 10}}


@cache
def full() -> March:
    return march(tiny().using({"reducer": "full"}))


def snapshots() -> dict[str, FloatArray]:
    return {n: full().block(n).T for n in full().model.reducible()}


def prepared(scene: Scene, seed: int = 3) -> StepSolver:
    solver: StepSolver = scene.reducer.prepare(ReducedProblem(
        full().model, scene.integrator, scene.time.step, Offline.from_snapshots(
            full().model, snapshots()),
        np.random.default_rng(seed)))
    return solver
