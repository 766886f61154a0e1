"""Offline products: the training run and everything made from it, cached by what they depend on."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.assemble import assemble
from sparsemor.core.cache import Cache, digest
from sparsemor.core.hooks import Manager, RunStart, new_manager
from sparsemor.core.initial import consistent_state
from sparsemor.core.model import Model
from sparsemor.core.protocols import Basis, Dictionary, StepSolver
from sparsemor.core.scene import Scene
from sparsemor.core.status import SolveFailed


class Offline:
    """What reducers are prepared from. `used`: product -> "hit" or "miss" of the cache.

    snapshots(name) (n, M): unknowns of a block over the training run, in columns.
    """

    def __init__(
        self, model: Model, train: Callable[[], Mapping[str, FloatArray]], key: str,
        cache: Cache | None, manager: Manager | None = None,
    ) -> None:
        self._model, self._train, self._key, self._cache = model, train, key, cache
        self._snapshots: Mapping[str, FloatArray] | None = None
        self.manager = manager or new_manager()
        self.used: dict[str, str] = {}
        self.seconds: dict[str, float] = {}

    @classmethod
    def of(cls, model: Model, snapshots: Mapping[str, FloatArray]) -> "Offline":
        """Given snapshots (n, M) a block, no cache: for scripts and tests."""
        rows = {name: s.T for name, s in snapshots.items()}
        return cls(model, lambda: rows, "", None)

    def snapshots(self, name: str) -> FloatArray:
        if self._snapshots is None:
            self._snapshots = self.remember("training", (), self._train)
        return self._snapshots[name].T

    def remember(
        self, kind: str, depends: Sequence[Any], make: Callable[[], Mapping[str, Any]]
    ) -> Mapping[str, Any]:
        """Arrays of one product: from the cache, or made and kept there."""
        start = time.perf_counter()
        if self._cache is None:
            arrays, hit = make(), False
        else:
            arrays, hit = self._cache.get_or_make(kind, digest(self._key, *depends), make)
        label = "hit" if hit else "miss"
        self.used[kind] = label if self.used.get(kind, label) == label else "mixed"
        self.seconds[kind] = self.seconds.get(kind, 0.0) + time.perf_counter() - start
        return arrays

    def dictionary(self, name: str, basis: Basis) -> tuple[Dictionary, float]:
        """A block's dictionary and the largest coefficient that its snapshots have (0: none)."""
        def make() -> Mapping[str, Any]:
            snapshots = self.snapshots(name) if basis.needs_snapshots else None
            d = basis.build(self._model.block_data(name, snapshots))
            top = 0.0
            if snapshots is not None and snapshots.size:
                # orthonormal atoms: the projection; others: an upper estimate is all we need
                top = float(np.abs(d.atoms.T @ (snapshots - d.offset[:, None])).max())
            info = np.array(json.dumps(dict(d.info)))
            return {"atoms": d.atoms, "offset": d.offset, "top": np.array(top),
                    "provenance": np.array(d.provenance), "info": info}

        a = self.remember("basis", (name, basis), make)
        provenance = tuple(str(p) for p in a["provenance"])
        d = Dictionary(np.asarray(a["atoms"]), np.asarray(a["offset"]), provenance,
                       json.loads(str(a["info"])))
        return d, float(a["top"])


def offline_of(scene: Scene, model: Model, cache: Cache, manager: Manager) -> Offline:
    """The offline products of a scene. The key holds the training scene and every mesh."""
    training = scene.for_training()
    from importlib.metadata import version

    meshes = [m for p in model.parts.values() if (m := getattr(p, "mesh", None)) is not None]
    # what full order does not depend on must not cost a training run: another seed, other probes
    physics = training.using({"title": "", "seed": 0, "output": {}, "probes": {}}, label="training")
    key = digest(physics.digest(), training.training.every, version("sparsemor"),
                 [[m.points, m.cells] for m in meshes])
    return Offline(model, lambda: train(training, manager), key, cache, manager)


@np.errstate(all="ignore")  # overflow is a status of the step, not a warning
def train(scene: Scene, manager: Manager) -> dict[str, FloatArray]:
    """Full-order run of the training scene; block -> (M, n) unknowns at the start and after
    every `training.every` steps, and for second-order integrators x + h^2 a of the start.

    Raises SolveFailed when it stops before its end.
    """
    model = assemble(scene)
    h, steps = scene.time.step, step_count(scene)
    every = scene.training.every
    solver: StepSolver = scene.reducer.prepare(
        model, scene.integrator, h, Offline.of(model, {}), np.random.default_rng(scene.seed))
    state, memory = solver.start(consistent_state(model))
    state = scene.integrator.start(solver.layout, state)
    # a second-order rule carries the first accelerations on: its snapshots must span them too
    extra = int(scene.integrator.order > 1)
    kept = {n: np.empty((steps // every + 1 + extra, model.layout[n].stop - model.layout[n].start))
            for n in model.reducible()}
    for name, rows in kept.items():
        rows[0] = state.x[model.layout[name]]
        rows[-1] = (state.x + h * h * state.a)[model.layout[name]]
    manager.hook.on_start(run=RunStart(scene.title, "full", 0.0, steps * h, steps, "training"))
    for n in range(1, steps + 1):
        formula = scene.integrator.formula(solver.layout, state, h)
        outcome, memory = solver.solve(formula, memory)
        if not outcome.status.ok:
            where = f"training run: {outcome.detail}" if outcome.detail else "training run"
            manager.hook.on_failure(
                status=outcome.status, t=formula.t, block=outcome.block, detail=where)
            manager.hook.on_finish(summary={"phase": "training", "steps": n - 1})
            raise SolveFailed(outcome.status, formula.t, outcome.block, where)
        state = scene.integrator.advance(solver.layout, state, formula, outcome.x, h)
        if n % every == 0:
            for name, rows in kept.items():
                rows[n // every] = state.x[model.layout[name]]
        if manager.has_observers:
            manager.hook.on_step(step=n, t=state.t, x=state.x, outcome=outcome)
    manager.hook.on_finish(summary={"phase": "training", "steps": steps})
    return kept


def step_count(scene: Scene) -> int:
    """Number of steps of time.step up to time.end (rounded; a remainder below 1e-6 steps)."""
    return round(scene.time.end / scene.time.step)
