"""Offline products: the training run and everything made from it, cached by what they depend on."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace

import numpy as np

from sparsemor.core.arrays import Arrays, FloatArray
from sparsemor.core.linalg.least_squares import least_squares_coefficients
from sparsemor.core.linalg.snapshots import column_chunks
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols import (
    Basis,
    BlockData,
    Dictionary,
    Recording,
    ReducedProblem,
    State,
    StepFactors,
    StepSolver,
)
from sparsemor.core.registry.hooks import Manager, RunStart, new_manager
from sparsemor.core.registry.returned_values import built_dictionary
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.step_control import controlled, step_of
from sparsemor.core.simulation.time_stepping import iterate, started
from sparsemor.core.status import SolveFailed


class Offline:
    """Offline data from which reducers are prepared, cached in `products`.

    snapshots(name) (n, M): unknowns of a block over the training run, in columns; recording: how
    they were taken, None when they were given; trained: whether some basis needs snapshots, also
    where it came from the cache; expected: bytes that a run will hold, once estimated. reducer:
    origin of a reducer that is not sparsemor's own, part of the key of its products.
    """

    def __init__(
        self, model: Model, train: Callable[[], Mapping[str, FloatArray]], key: str,
        products: Products, manager: Manager | None = None, recording: Recording | None = None,
        reducer: Sequence[object] = (),
    ) -> None:
        self._model, self._train, self._key = model, train, key
        self._reducer = list(reducer)
        self._snapshots: Mapping[str, FloatArray] | None = None
        self.manager, self.recording = manager or new_manager(), recording
        self.products = products
        self.trained = False
        self.expected: float | None = None

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
        self, kind: str, depends: Sequence[object], make: Callable[[], Arrays]
    ) -> Arrays:
        """Arrays of one product of the reducer: from the cache, or made and kept there."""
        return self._remembered(kind, (*self._reducer, *depends), make)

    def _remembered(
        self, kind: str, depends: Sequence[object], make: Callable[[], Arrays]
    ) -> Arrays:
        key = "" if self.products.cache is None else digest(self._key, *depends)
        return self.products.remember(kind, key, make)

    def has(self, kind: str, depends: Sequence[object] = ()) -> bool:
        """True if a product is in the cache."""
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

        def make() -> Arrays:
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


_NESTED = frozenset({"heat", "moving"})
"""Fields of a block's data that are digested entry by entry."""


def _content(data: BlockData) -> list[object]:
    """Contents of a block for its digest."""
    values = [getattr(data, f.name) for f in fields(data) if f.name not in _NESTED]
    values += [[m.source, m.columns, m.names, m.table.times, m.table.values] for m in data.moving]
    return values if data.heat is None else [*values, *_content(data.heat)]


def largest_coefficient(d: Dictionary, snapshots: FloatArray) -> float:
    """Largest |coefficient| that snapshots (n, M) have in a dictionary; 0 without snapshots.

    Coefficients are projections on orthonormal atoms, else least-squares solutions of minimum norm:
    inner products with nearly parallel atoms are no coefficients.
    """
    if not snapshots.size or not d.atoms.shape[1]:
        return 0.0
    return max(float(np.abs(least_squares_coefficients(d.atoms, values - d.offset[:, None])).max())
               for _, values in column_chunks(snapshots))


def full_run(
    scene: Scene, model: Model, offline: Offline, manager: Manager, phase: str
) -> Iterator[State]:
    """The states of a run that others are made from, its start first. `phase` ("training run",
    "rigid stage") is what its events and the detail of a failure say.

    Raises SolveFailed when it stops before its end.
    """
    h, steps = scene.time.step, step_count(scene)
    solver: StepSolver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, h, offline, np.random.default_rng(scene.seed)))
    solver = controlled(scene, model, offline, solver)
    step = step_of(solver, scene.integrator, h)
    state, memory = started(solver, scene.integrator, consistent_state(model))
    name = phase.removesuffix(" run")
    manager.hook.on_start(run=RunStart(
        scene.title, scene.reducer_name, 0.0, steps * h, steps, name))
    yield state
    for n, taken in enumerate(iterate(step, state, memory, steps), 1):
        outcome, state = taken.outcome, taken.state
        if not outcome.status.ok:
            where = f"{phase}: {outcome.detail}" if outcome.detail else phase
            manager.hook.on_failure(
                status=outcome.status, t=state.t + h, block=outcome.block, detail=where)
            manager.hook.on_finish(summary={"phase": name, "steps": n - 1})
            raise SolveFailed(outcome.status, state.t + h, outcome.block, where, phase=phase)
        yield state
        if manager.has_observers:
            manager.hook.on_step(step=n, t=state.t, x=state.x, outcome=outcome)
    manager.hook.on_finish(summary={"phase": name, "steps": steps})


def step_count(scene: Scene) -> int:
    """Number of steps of time.step up to time.end (rounded; a remainder below 1e-6 steps)."""
    return round(scene.time.end / scene.time.step)
