"""Reduced runs in memory: their training, their full unknowns, and estimates of their error."""

import numpy as np

from sparsemor.core import ReducedProblem, State
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.testing.in_memory_run import March
from sparsemor.reducers.estimation.coupled_errors import CoupledErrors
from sparsemor.reducers.estimation.error_model_assembly import error_model
from sparsemor.reducers.estimation.estimator import ErrorModel
from sparsemor.reducers.reducer_options import ReducedStepOptions


def learnt(run: March) -> dict[str, FloatArray]:
    """Block -> (n, T) what `run` was at, as snapshots."""
    return {n: run.block(n).T for n in run.model.reducible()}


def decoded(run: March, name: str) -> FloatArray:
    """(T, n) a block in its full unknowns."""
    x, maps = run.block(name), run.solver.dictionaries
    return x if name not in maps else np.asarray(maps[name].offset + x @ maps[name].atoms.T)


def states(run: March) -> list[State]:
    return [State(t, x, v, a, np.zeros((len(x), 0)))
            for t, x, v, a in zip(run.t.tolist(), run.x, run.v, run.a, strict=True)]


def model_of(scene: Scene, run: March, every: int = 1) -> ErrorModel | CoupledErrors:
    """Error model for the steps of a reduced run of `scene`."""
    problem = ReducedProblem(
        run.model, scene.integrator, scene.time.step, Offline.from_snapshots(run.model, {}),
        np.random.default_rng(0))
    reducer = scene.reducer
    assert isinstance(reducer, ReducedStepOptions)
    return error_model(problem, run.solver, every, reducer.active_atoms)


def estimates(scene: Scene, run: March, every: int = 1) -> dict[str, FloatArray]:
    """Block -> estimated error norm at every `every`-th state of a reduced run, the first one
    included."""
    model, known = model_of(scene, run, every), states(run)
    memory = model.start(consistent_state(run.model), known[0])
    first = model.present(memory)
    later = model.advance([known[i - every + 1 : i + 1] for i in range(
        every, len(known), every)], memory)
    return {n: np.concatenate([[first[n]], later[n]]) for n in model.blocks}


def errors(full: March, run: March, name: str) -> FloatArray:
    """Norms of the error of one block of a reduced run."""
    return np.asarray(np.linalg.norm(full.block(name) - decoded(run, name), axis=1))
