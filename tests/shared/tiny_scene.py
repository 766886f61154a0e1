"""The scene tests/scenes/tiny.yaml, its full-order run, and reducers prepared on that run."""

from functools import cache
from pathlib import Path

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.offline import Offline
from sparsemor.core.protocols import StepSolver
from sparsemor.core.scene import Scene, load
from sparsemor.core.testing.run import March, march

TINY = load(Path(__file__).parents[1] / "scenes" / "tiny.yaml")
BUDGETS = {"*.elastic": {"rows": 14, "atoms": 4}, "*.thermal": {"rows": 10, "atoms": 3}}
FIXED = {"*.elastic": {"rows": 14}, "*.thermal": {"rows": 10}}


@cache
def full() -> March:
    return march(TINY.using({"reducer": "full"}))


def snapshots() -> dict[str, FloatArray]:
    return {n: full().block(n).T for n in full().model.reducible()}


def prepared(scene: Scene, seed: int = 3) -> StepSolver:
    solver: StepSolver = scene.reducer.prepare(
        full().model, scene.integrator, scene.time.step,
        Offline.of(full().model, snapshots()), np.random.default_rng(seed))
    return solver
