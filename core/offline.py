"""Offline products: the training run and everything made from it, cached by what they depend on."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.assemble import assemble
from sparsemor.core.block_solvers import told_in
from sparsemor.core.cache import digest
from sparsemor.core.coefficients import coefficients
from sparsemor.core.hooks import Manager, RunStart, new_manager
from sparsemor.core.identity import Identity, mesh_content, origin
from sparsemor.core.initial import consistent_state
from sparsemor.core.model import Model, StepFactors
from sparsemor.core.physics import physics_of, training_physics
from sparsemor.core.products import Products
from sparsemor.core.protocols import Basis, BlockData, Dictionary, Integrator, State, StepSolver
from sparsemor.core.returned import built_dictionary
from sparsemor.core.scene import Scene
from sparsemor.core.snapshots import stretches
from sparsemor.core.status import SolveFailed
from sparsemor.core.step_control import controlled, step_of
from sparsemor.core.training import SnapshotKeeper
from sparsemor.core.workshop import Workshop

if TYPE_CHECKING:
    from sparsemor.core.estimate import Estimate

TRAINING = "training run"
"""How the detail of a failure begins that happened in the training run."""


@dataclass(frozen=True, slots=True)
class Recording:
    """How training snapshots came about: `every` that many steps of `step` s, by `integrator`.

    end: of the training run, s. Where its order is above 1, the last snapshot is x + h^2 a of the
    start (see `train`).
    """

    integrator: Integrator
    step: float
    every: int
    end: float = 0.0


class Offline:
    """What reducers are prepared from, kept among its `products`.

    snapshots(name) (n, M): unknowns of a block over the training run, in columns; recording: how
    they were taken, None when they were given; trained: whether some basis needs snapshots, also
    where it came from the cache; expected: what a run will hold in memory, once told. reducer:
    origin of a reducer that is not sparsemor's own, part of the key of its products.
    """

    def __init__(
        self, model: Model, train: Callable[[], Mapping[str, FloatArray]], key: str,
        products: Products, manager: Manager | None = None, recording: Recording | None = None,
        reducer: Sequence[Any] = (),
    ) -> None:
        self._model, self._train, self._key = model, train, key
        self._reducer = list(reducer)
        self._snapshots: Mapping[str, FloatArray] | None = None
        self.manager, self.recording = manager or new_manager(), recording
        self.products = products
        self.trained = False
        self.expected: Estimate | None = None

    @classmethod
    def of(cls, model: Model, snapshots: Mapping[str, FloatArray]) -> "Offline":
        """Given snapshots (n, M) a block, no cache: for scripts and tests."""
        rows = {name: s.T for name, s in snapshots.items()}
        return cls(model, lambda: rows, "", Products(None))

    def snapshots(self, name: str) -> FloatArray:
        if self._snapshots is None:
            self._snapshots = self._remembered("training", (), self._train)
        return self._snapshots[name].T

    def remember(
        self, kind: str, depends: Sequence[Any], make: Callable[[], Mapping[str, Any]]
    ) -> Mapping[str, Any]:
        """Arrays of one product of the reducer: from the cache, or made and kept there."""
        return self._remembered(kind, (*self._reducer, *depends), make)

    def _remembered(
        self, kind: str, depends: Sequence[Any], make: Callable[[], Mapping[str, Any]]
    ) -> Mapping[str, Any]:
        key = "" if self.products.cache is None else digest(self._key, *depends)
        return self.products.remember(kind, key, make)

    def has(self, kind: str, depends: Sequence[Any] = ()) -> bool:
        """Whether a product is in the cache."""
        cache = self.products.cache
        return cache is not None and cache.place(kind, digest(self._key, *depends)).exists()

    def keep_training(self, snapshots: Mapping[str, FloatArray], seconds: float) -> None:
        """Training snapshots (M, n) by block that another run came by, in `seconds` s."""
        if self.products.cache is not None:
            self.products.keep("training", digest(self._key), snapshots, seconds)

    def dictionary(
        self, name: str, basis: Basis, step: StepFactors | None = None
    ) -> tuple[Dictionary, float]:
        """A block's dictionary and the largest coefficient that its snapshots have (0: none);
        step: the steps that it is to serve."""
        known = self._model.block_data(name, step=step)
        self.trained = self.trained or basis.needs_snapshots

        def make() -> Mapping[str, Any]:
            snapshots = self.snapshots(name) if basis.needs_snapshots else None
            given = known if snapshots is None else replace(known, snapshots=snapshots)
            if snapshots is not None and known.heat is not None:
                given = replace(given, heat=replace(
                    known.heat, snapshots=self.snapshots(known.heat.name)))
            d = built_dictionary(basis, given)
            top = 0.0 if snapshots is None else largest_coefficient(d, snapshots)
            info = np.array(json.dumps(dict(d.info)))
            return {"atoms": d.atoms, "offset": d.offset, "top": np.array(top),
                    "provenance": np.array(d.provenance), "info": info}

        # the key tells the training scene; loads and operators are those of the scene that is run
        a = self._remembered("basis", (name, basis, *_content(known)), make)
        provenance = tuple(str(p) for p in a["provenance"])
        d = Dictionary(np.asarray(a["atoms"]), np.asarray(a["offset"]), provenance,
                       json.loads(str(a["info"])))
        return d, float(a["top"])


def _content(data: BlockData) -> list[Any]:
    """What a block is made of, to be digested."""
    values = [getattr(data, f.name) for f in fields(data) if f.name not in ("heat", "moving")]
    values += [[m.source, m.columns, m.names, m.table.times, m.table.values] for m in data.moving]
    return values if data.heat is None else [*values, *_content(data.heat)]


def largest_coefficient(d: Dictionary, snapshots: FloatArray) -> float:
    """Largest |coefficient| that snapshots (n, M) have in a dictionary; 0 without snapshots.

    Of orthonormal atoms the projection, of others the least-squares solution of least norm:
    correlations with coherent atoms would be off by any factor.
    """
    if not snapshots.size or not d.atoms.shape[1]:
        return 0.0
    return max(float(np.abs(coefficients(d.atoms, values - d.offset[:, None])).max())
               for _, values in stretches(snapshots))


def offline_of(
    scene: Scene, model: Model, products: Products, manager: Manager, shop: Workshop | None = None
) -> Offline:
    """The offline products of a scene. The key holds the physics of the training scene, its
    identity (code, plugins, files) and every mesh. shop: what was built for the model, for the
    training run's."""
    training, physics = training_physics(scene)
    key = digest(physics.digest(), training.training.every, Identity.of(physics).plain(),
                 mesh_content(model))
    recording = Recording(training.integrator, training.time.step, training.training.every,
                          training.time.end)
    return Offline(
        model, lambda: train(training, manager, products, shop), key, products, manager, recording,
        origin(type(scene.reducer)))


def is_training_run(scene: Scene) -> bool:
    """Whether the run of this scene is the training run of its own reduced models."""
    settings = {"training": {"every": scene.training.every}}
    own = physics_of(scene.using(settings), "training")
    return own.digest() == training_physics(scene)[1].digest()


@np.errstate(all="ignore")  # overflow is a status of the step, not a warning
def train(
    scene: Scene, manager: Manager, products: Products | None = None,
    shop: Workshop | None = None,
) -> dict[str, FloatArray]:
    """Full-order run of the training scene; block -> (M, n) unknowns at the start and after
    every `training.every` steps, and for second-order integrators x + h^2 a of the start.

    Raises SolveFailed when it stops before its end, or its rigid stage does.
    """
    if scene.rigid_stage is None:
        model = assemble(scene, shop=shop)
    else:  # which is a run of its own, by this module's means
        from sparsemor.core.rigid_stage import staged

        model = staged(scene, products or Products(None), manager, shop or Workshop())
    products = products or Products(None)
    keeper = SnapshotKeeper(
        scene, step_count(scene), model.layout, model.reducible(), products.scratch)
    try:
        for n, state in enumerate(
                full_run(scene, model, Offline.of(model, {}), manager, TRAINING)):
            keeper.take(n, state)
        return dict(keeper.finished())
    finally:
        keeper.close()
        products.told += told_in(TRAINING, model.solvers.log)


def full_run(
    scene: Scene, model: Model, offline: Offline, manager: Manager, phase: str
) -> Iterator[State]:
    """The states of a run that others are made from, its start first. `phase` ("training run",
    "rigid stage") is what its events and the detail of a failure say.

    Raises SolveFailed when it stops before its end.
    """
    h, steps = scene.time.step, step_count(scene)
    solver: StepSolver = scene.reducer.prepare(
        model, scene.integrator, h, offline, np.random.default_rng(scene.seed))
    solver = controlled(scene, model, offline, solver)
    step = step_of(solver, scene.integrator, h)
    state, memory = solver.start(consistent_state(model))
    state = scene.integrator.start(solver.layout, state)
    told = phase.removesuffix(" run")
    manager.hook.on_start(run=RunStart(scene.title, "full", 0.0, steps * h, steps, told))
    yield state
    for n in range(1, steps + 1):
        outcome, state, memory = step(state, memory)
        if not outcome.status.ok:
            where = f"{phase}: {outcome.detail}" if outcome.detail else phase
            manager.hook.on_failure(
                status=outcome.status, t=state.t + h, block=outcome.block, detail=where)
            manager.hook.on_finish(summary={"phase": told, "steps": n - 1})
            raise SolveFailed(outcome.status, state.t + h, outcome.block, where)
        yield state
        if manager.has_observers:
            manager.hook.on_step(step=n, t=state.t, x=state.x, outcome=outcome)
    manager.hook.on_finish(summary={"phase": told, "steps": steps})


def step_count(scene: Scene) -> int:
    """Number of steps of time.step up to time.end (rounded; a remainder below 1e-6 steps)."""
    return round(scene.time.end / scene.time.step)
