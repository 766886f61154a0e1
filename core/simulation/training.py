"""Training run: full-order snapshots of each block, from which reduced bases are computed."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.linalg.snapshots import SnapshotWriter
from sparsemor.core.model.assembly import BodyCache, assemble
from sparsemor.core.model.factorizations import factorizations_in
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.reducer import Recording
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.scene.default_plugins import FULL_ORDER, LARGEST_ERROR
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.run_identity import Identity, origin, physics_of, training_physics
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.initial_from_result import started_from_result
from sparsemor.core.simulation.memory.estimate import trains
from sparsemor.core.simulation.offline import STATE, Offline, TrainingRun, full_run, step_count
from sparsemor.core.simulation.offline_cache import Products, mesh_content
from sparsemor.core.simulation.rigid_stage import staged
from sparsemor.core.status import SolveFailed

TRAINING = "training run"
"""Prefix of messages about failures of the training run."""


STATES, AHEAD = 5, 4000
"""Number of whole states that a training run keeps, and the number of steps over which they are
spread."""


def state_steps(steps: int) -> list[int]:
    """Steps of a run after which whole states are kept, evenly spread from its start to its end, or
    over its first `AHEAD` steps."""
    last = min(steps, AHEAD)
    return sorted({round(i * last / (STATES - 1)) for i in range(STATES)})


class SnapshotCollector:
    """Recorder of the training snapshots of `scene` during a full-order run.

    Rows of each block's (M, n): the initial state, every `training.every`-th step and, for
    integrators of an order above 1, at last x + h^2 a of the initial state, because their first
    step contains the initial accelerations. Also a few whole states (`state_steps`): t (M,), x, v
    and a (M, n), with the names of `STATE`. steps: those of the training run, which are the first
    of `whole` (all of them by default).
    """

    def __init__(
        self, scene: Scene, steps: int, layout: Layout, blocks: tuple[str, ...],
        folder: Callable[[], Path], whole: int = 0,
    ) -> None:
        """steps: number of those of the training run, the first of `whole` (0: all); blocks: those
        of which snapshots are kept; folder: makes the folder for snapshots that do not fit in
        memory. share: of the steps of the run that belong to the training run; _first: x + h^2 a of
        the initial state, None for integrators of order 1; _due: steps with a whole state."""
        self.steps, self.share = steps, steps / (whole or steps)
        self.every, self._h, self._layout = scene.training.every, scene.time.step, layout
        extra = int(scene.integrator.order > 1)
        count = steps // self.every + 1 + extra
        self._kept = {n: SnapshotWriter(n, count, layout[n].stop - layout[n].start, folder)
                      for n in blocks}
        self._first = np.zeros(0) if extra else None
        self._due, self._states = frozenset(state_steps(steps)), list[State]()

    def take(self, step: int, state: State) -> None:
        """Records the state after `step` steps (0: initial state) if it is a snapshot."""
        if step == 0 and self._first is not None:
            self._first = state.x + self._h * self._h * state.a
        if step in self._due:
            self._states.append(state)
        if step % self.every == 0 and step <= self.steps:
            for name, rows in self._kept.items():
                rows.append(state.x[self._layout[name]])

    def finished(self) -> Mapping[str, FloatArray]:
        """Block -> snapshots (M, n), after the last step."""
        for name, rows in self._kept.items():
            if self._first is not None:
                rows.append(self._first[self._layout[name]])
        states = zip(STATE, zip(*((s.t, s.x, s.v, s.a) for s in self._states), strict=True),
                     strict=True)
        return {name: rows.finished() for name, rows in self._kept.items()} | {
            name: np.array(values) for name, values in states}

    def close(self) -> None:
        """Closes scratch files, also after a run that failed."""
        for rows in self._kept.values():
            rows.close()


def offline_of(
    scene: Scene, model: Model, products: Products, manager: Manager,
    body_cache: BodyCache | None = None,
) -> Offline:
    """Offline data of a scene. The cache key of a training run contains its physics, its identity
    (code, plugins, files) and every mesh. body_cache: bodies of the model, for the training runs.
    """
    # box: points of the box of parameters, one for each of several training runs; None for one run
    mesh, box = mesh_content(model), scene.training.parameters

    def run(own: Mapping[str, Any]) -> TrainingRun:
        training, physics = training_physics(scene, own)
        identity = Identity.from_scene(physics).plain()
        key = digest(physics.digest(), training.training.every, identity, mesh)
        make = partial(train, training, manager, products, body_cache)
        return key, make if scene.training.loads is None else partial(_under_loads, make)

    def runs() -> Sequence[TrainingRun]:
        # `trains`: a basis needs snapshots; it does not depend on the sizes of blocks
        if not scene.training.several or not trains(
                scene, dict.fromkeys(model.reducible(), 0), model):
            return [run({})]
        return [run(own) for own in scene.training_changes]

    def in_parallel(missing: Sequence[str]) -> None:
        from sparsemor.core.simulation.workers.training_runs import train_in_parallel

        assert box is not None and products.cache is not None
        changes = {digest(run(own)[0]): own for own in scene.training_changes}
        train_in_parallel(
            scene, {k: changes[k] for k in missing}, products.cache, box.workers,
            lambda done: manager.hook.on_offline(
                product=f"training runs, {done} of {len(missing)} done"))

    training = scene.for_training()
    recording = Recording(training.integrator, training.time.step, training.training.every,
                          training.time.end)
    return Offline(model, runs, products, manager, recording, origin(type(scene.reducer)),
                   in_parallel if box is not None and box.workers > 1 else None)


def _under_loads(make: Callable[[], Mapping[str, FloatArray]]) -> Mapping[str, FloatArray]:
    """A training run under loads that vary; its failure advises on their ranges."""
    try:
        return make()
    except SolveFailed as error:
        raise SolveFailed(
            error.status, error.time, error.block, error.detail, phase=error.phase,
            advice="the scene does not bear all that training.loads declares: give ranges that a "
            "run can have, such as {push: [0.5, 1]}, or name fewer loads") from None


def snapshot_collector(scene: Scene, model: Model, offline: Offline) -> SnapshotCollector | None:
    """Recorder of training snapshots, if this run begins with a training run whose snapshots are
    not in the cache; else None."""
    if not model.reducible() or not (count := training_steps(scene)) or offline.has_training():
        return None
    return SnapshotCollector(scene, count, model.layout, model.reducible(),
                          offline.products.scratch, step_count(scene))


def training_steps(scene: Scene) -> int:
    """Number of the first steps of a run at full order that are the training run of the scene's
    reduced models, 0 if none are. (Steps of controlled error, and those after a rigid-body
    pre-simulation, are the same only in a run of the same length.)"""
    if scene.training.several:  # none with the values of the scene
        return 0
    training, physics = training_physics(scene)
    end, settings = training.time.end, dict[str, Any](training={"every": scene.training.every})
    if end != scene.time.end:
        if end > scene.time.end or scene.time.control is not None or scene.rigid_stage is not None:
            return 0
        settings["time.end"] = end
    if scene.reducer_name == FULL_ORDER:  # steps of a smaller error are as good
        remaining = scene.dump()["reducer"]["remaining"]
        settings["reducer.remaining"] = max(remaining, LARGEST_ERROR)
    own = physics_of(scene.using(settings), "training")
    return step_count(training) if own.digest() == physics.digest() else 0


def in_training(scene: Scene) -> bool:
    """True if the run of a scene at full order is its training run."""
    full = scene.using({"reducer": {"use": FULL_ORDER}}, label="full order")
    return training_steps(full) == step_count(full)


@np.errstate(all="ignore")  # overflow is a status of the step, not a warning
def train(
    scene: Scene, manager: Manager, products: Products | None = None,
    body_cache: BodyCache | None = None,
) -> dict[str, FloatArray]:
    """Full-order run of the training scene: block -> snapshots (M, n) at the start and after every
    `training.every` steps, and for integrators of an order above 1 x + h^2 a of the start.

    Raises SolveFailed if it or its rigid-body pre-simulation stops early.
    """
    if scene.rigid_stage is None:
        model = started_from_result(scene, assemble(scene, body_cache=body_cache))
    else:
        model = staged(scene, products or Products(None), manager, body_cache or BodyCache())
    products = products or Products(None)
    collector = SnapshotCollector(
        scene, step_count(scene), model.layout, model.reducible(), products.scratch)
    try:
        for n, state in enumerate(
                full_run(scene, model, Offline.from_snapshots(model, {}), manager, TRAINING)):
            collector.take(n, state)
        return dict(collector.finished())
    finally:
        collector.close()
        products.factorizations += factorizations_in(TRAINING, model.solvers.log)
