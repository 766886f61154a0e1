"""Offline stage: the training run and everything computed from it, cached by its inputs."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import fields, replace
from functools import cached_property, partial

import numpy as np

from sparsemor.core.arrays import Arrays, FloatArray
from sparsemor.core.linalg.dense import least_squares_coefficients
from sparsemor.core.linalg.snapshots import column_chunks
from sparsemor.core.model.initial_state import resolved_start
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.basis import Basis, BlockData, Dictionary
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.reducer import Recording, StepFactors
from sparsemor.core.protocols.step_solver import StepSolver
from sparsemor.core.protocols.time_function import holding
from sparsemor.core.registry.hooks import Manager, RunStart, new_manager
from sparsemor.core.registry.returned_values import built_dictionary
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.blow_up import Extents, diverged
from sparsemor.core.simulation.controllers import Controllers, sensors
from sparsemor.core.simulation.offline_cache import OfflineProduct, Products
from sparsemor.core.simulation.step_control import controlled, step_of
from sparsemor.core.simulation.time_stepping import iterate, problem_of, started
from sparsemor.core.status import SolveFailed

TrainingRun = tuple[str, Callable[[], Mapping[str, FloatArray]]]
"""Cache key of a training run, and the function that makes it."""


STATE = ("state_t", "state_x", "state_v", "state_a")
"""Names of the arrays of whole states next to the snapshots of a training run."""


class Offline:
    """Offline data from which reducers are prepared, cached in `products`.

    snapshots(name) (n, M): columns with the n unknowns of a block (one field of one body) at M
    times of the training runs. training: key of each training run and function that returns its
    snapshots (M, n) by block, evaluated at the first use, because the choice of runs may need runs.
    recording: integrator, step size and interval of the snapshots, None for snapshots that were
    passed in. trained: True if a basis needs snapshots, also if the basis came from the cache.
    expected: estimated memory of the run, bytes, None before the estimate.
    reducer: identity of a third-party reducer, part of its cache keys. parallel: makes several
    training runs at once and stores them in the cache under the keys that it is called with; None
    if they are made one after the other.
    """

    def __init__(
        self, model: Model, training: Callable[[], Sequence[TrainingRun]], products: Products,
        manager: Manager | None = None, recording: Recording | None = None,
        reducer: Sequence[object] = (), parallel: Callable[[Sequence[str]], None] | None = None,
    ) -> None:
        """training: makes the list of training runs; manager: of observers, to which events are
        reported; others: as in the class.

        _dictionaries: block -> its dictionary and largest coefficient, with the digest of basis
        and step for which it was made in `_requested`; _inherited: those of another model that are
        taken as they are; _read_only: what is not computed yet raises LookupError. trained: True
        once a basis has asked for snapshots; expected: estimated memory of the run, bytes."""
        self._model, self._training, self._parallel = model, training, parallel
        self._reducer = list(reducer)
        self._snapshots: Mapping[str, FloatArray] | None = None
        self._dictionaries: dict[str, tuple[Dictionary, float]] = {}
        self._requested: dict[str, str] = {}
        self._inherited: Mapping[str, tuple[Dictionary, float]] = {}
        self.manager, self._recording = manager or new_manager(), recording
        self.products = products
        self.trained, self._read_only = False, False
        self.expected: float | None = None

    @classmethod
    def from_snapshots(cls, model: Model, snapshots: Mapping[str, FloatArray]) -> "Offline":
        """Offline data of snapshots (n, M) per block, without training run and cache: for scripts
        and tests."""
        rows = {name: s.T for name, s in snapshots.items()}
        return cls(model, lambda: [("", lambda: rows)], Products(None))

    def of_model(self, model: Model, products: Products, atoms: int | None = None) -> "Offline":
        """The same training and trial bases, or their first `atoms` atoms, for a model with other
        parameters."""
        new = Offline(model, lambda: self._runs, products, self.manager, self._recording,
                      self._reducer)
        known = self._dictionaries or self._inherited
        new._inherited = known if atoms is None else {
            name: (d.leading(atoms), top) for name, (d, top) in known.items()}
        new.trained = self.trained
        return new

    def as_computed(self) -> "Offline":
        """The same offline data for another step size, without work: what has not been computed
        raises LookupError."""
        copy = self.of_model(self._model, self.products)
        copy._read_only = True
        return copy

    def without_snapshots(self) -> "Offline":
        """Itself; snapshots are read again from the cache if they are needed again."""
        self._snapshots = None
        return self

    @cached_property
    def _runs(self) -> Sequence[TrainingRun]:
        return self._training()

    @cached_property
    def _key(self) -> str:
        keys = [key for key, _ in self._runs]
        return keys[0] if len(keys) == 1 else digest(keys)

    @property
    def recording(self) -> Recording | None:
        return self._recording and replace(self._recording, runs=len(self._runs))

    def train(self) -> Mapping[str, FloatArray]:
        """Snapshots (M, n) of all blocks: of training runs that are read from the cache, or made.
        Raises SolveFailed if one stops early."""
        if self._snapshots is None:
            in_parallel = self._train_in_parallel()  # number of runs that other processes made
            found = []
            for key, train in self._runs:
                found.append(self.products.remember("training", self._place(key), train))
            if in_parallel:
                self.products.used["training"] = "miss" if in_parallel == len(found) else "mixed"
            self._snapshots = found[0] if len(found) == 1 else {
                n: np.concatenate([each[n] for each in found]) for n in found[0]}
        # their computing times are part of those of the product that is computed from them
        self.products.spent.use(f"training/{self._place(key)}" for key, _ in self._runs)
        return self._snapshots

    def snapshots(self, name: str) -> FloatArray:
        return self.train()[name].T

    def states(self) -> Sequence[State]:
        """A few states of the training run, in all unknowns of its full-order model, from its start
        to its end; none of several runs."""
        if len(self._runs) > 1:
            return []
        t, x, v, a = (self.train()[name] for name in STATE)
        none = np.zeros((x.shape[1], 0))
        return [State(float(t[i]), x[i], v[i], a[i], none) for i in range(len(t))]

    def _train_in_parallel(self) -> int:
        """Number of training runs that other processes made, as they were not in the cache."""
        if self._parallel is None or self.products.cache is None:
            return 0
        places = (self._place(key) for key, _ in self._runs)
        missing = [p for p in places if not self.products.cache.has("training", p)]
        if len(missing) < 2:
            return 0
        with self.products.in_other_processes("training"):
            self._parallel(missing)
        return len(missing)

    def _place(self, key: str) -> str:
        return "" if self.products.cache is None else digest(key)

    def learning(self, count: int) -> "Offline":
        """Offline data of the first `count` snapshots alone, or of all training runs but the last
        if there are several, without a cache. For integrators of an order above 1 the last
        snapshot, made of the initial accelerations, remains."""
        several = len(self._runs) > 1
        extra = int(self.recording is not None and self.recording.integrator.order > 1)

        def first(run: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
            return {n: np.concatenate([X[:count], X[len(X) - extra:]]) for n, X in run.items()}

        def runs() -> Sequence[TrainingRun]:
            each = self.each_run(self._model.reducible())
            kept = each[:-1] if several else [first(each[0])]
            return [("", partial(dict, run)) for run in kept]  # no key, as there is no cache

        return Offline(self._model, runs, Products(None), self.manager, self._recording)

    def of_blocks(self, model: Model) -> "Offline":
        """The same training runs for a model with fewer blocks, without a cache."""
        return Offline(model, lambda: [
            ("", partial(dict, run)) for run in self.each_run(model.reducible())],
            Products(None), self.manager, self._recording)

    def each_run(self, names: Sequence[str]) -> Sequence[Mapping[str, FloatArray]]:
        """Snapshots (M, n) of some blocks in each of the training runs."""
        rows = {n: np.split(self.snapshots(n).T, len(self._runs)) for n in names}
        return [{n: X[i] for n, X in rows.items()} for i in range(len(self._runs))]

    def remember(
        self, kind: str, depends: Sequence[object], make: Callable[[], Arrays]
    ) -> Arrays:
        """Arrays of one offline product of the reducer: read from the cache, or computed by `make`
        and stored. depends: inputs of the product, part of the cache key."""
        with self.product(kind, depends) as product:
            if not product.hit:
                product.arrays = make()
        return product.arrays

    def product(
        self, kind: str, depends: Sequence[object]
    ) -> AbstractContextManager[OfflineProduct]:
        """Context around one offline product of the reducer (`Products.product`), for what is
        computed in the place where it is needed; depends: as for `remember`."""
        return self._product(kind, (*self._reducer, *depends))

    @contextmanager
    def _product(self, kind: str, depends: Sequence[object]) -> Iterator[OfflineProduct]:
        """Context around a product that depends on the training runs and on `depends`; what is to
        be computed is reported to observers."""
        cache = self.products.cache
        key = "" if cache is None else digest(self._key, *depends)
        if not self._read_only and (cache is None or not cache.has(kind, key)):
            self.manager.hook.on_offline(product=kind)
        with self.products.product(kind, key) as product:
            if self._read_only and not product.hit:
                raise LookupError(kind)
            yield product

    def has_training(self) -> bool:
        """True if the snapshots of all training runs are in the cache."""
        cache = self.products.cache
        return cache is not None and all(
            cache.has("training", digest(key)) for key, _ in self._runs)

    def keep_training(self, snapshots: Mapping[str, FloatArray], seconds: float) -> None:
        """Stores training snapshots (M, n) by block that another run recorded in `seconds` s."""
        if self.products.cache is not None:
            self.products.store("training", digest(self._key), snapshots, seconds)

    def dictionary(
        self, name: str, basis: Basis, step: StepFactors | None = None
    ) -> tuple[Dictionary, float]:
        """Dictionary (basis vectors, called atoms, and an offset) of a block, and the largest
        absolute coefficient of its snapshots (0 without snapshots). step: step factors of the runs
        that use it."""
        self.trained = self.trained or basis.needs_snapshots
        if name in self._inherited:  # from another model, taken as it is
            return self._inherited[name]
        requested = digest(basis, step)
        if self._requested.get(name) != requested:
            known = self._model.block_data(name, step=step)
            with self._product("basis", self._depends(basis, known)) as product:
                if not product.hit:
                    product.arrays = self._built(basis, known)
            a = product.arrays
            self._dictionaries[name] = Dictionary(
                np.asarray(a["atoms"]), np.asarray(a["offset"]),
                tuple(map(str, a["provenance"])), json.loads(str(a["info"]))), float(a["top"])
            self._requested[name] = requested
        return self._dictionaries[name]

    def has_dictionary(self, name: str, basis: Basis, step: StepFactors | None = None) -> bool:
        """True if the cache has this dictionary."""
        cache = self.products.cache
        return name in self._inherited or cache is not None and cache.has("basis", digest(
            self._key, *self._depends(basis, self._model.block_data(name, step=step))))

    def _depends(self, basis: Basis, known: BlockData) -> Sequence[object]:
        """Inputs of a dictionary for its cache key: that of the training tells the training scene;
        loads and operators are those of the scene that is run."""
        return known.name, basis, *_content(known)

    def _built(self, basis: Basis, known: BlockData) -> Arrays:
        """Arrays of the dictionary of a block."""
        if not basis.needs_snapshots:
            d, top = built_dictionary(basis, known), 0.0
        else:
            heat = known.heat and replace(known.heat, snapshots=self.snapshots(known.heat.name))
            snapshots = self.snapshots(known.name)
            d = built_dictionary(basis, replace(known, snapshots=snapshots, heat=heat))
            top = largest_coefficient(d, snapshots)
        return {"atoms": d.atoms, "offset": d.offset, "top": np.array(top),
                "provenance": np.array(d.provenance), "info": np.array(json.dumps(dict(d.info)))}


_NESTED = frozenset({"heat", "moving", "tangent"})
"""Fields of a block's data that are digested entry by entry, or follow from the bodies."""


def _content(data: BlockData) -> list[object]:
    """Values of a block's data that enter its digest (cache key)."""
    values = [getattr(data, f.name) for f in fields(data) if f.name not in _NESTED]
    values += [[m.source, m.columns, m.names, m.table.times, m.table.values] for m in data.moving]
    return values if data.heat is None else [*values, *_content(data.heat)]


def largest_coefficient(d: Dictionary, snapshots: FloatArray) -> float:
    """Largest absolute coefficient of snapshots (n, M) in a dictionary; 0 without snapshots or
    atoms.

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
    """States of an auxiliary run (training run or rigid-body pre-simulation), initial state first.
    phase: "training run" or "rigid stage", the name in events and failure messages.

    Raises SolveFailed if the run stops before its end.
    """
    h, steps = scene.time.step, step_count(scene)
    solver: StepSolver = scene.reducer.prepare(problem_of(scene, model, offline))
    solver = controlled(scene, model, offline, solver)
    controllers = Controllers(scene, sensors(model, solver.layout, solver.dictionaries))
    step = controllers.around(step_of(solver, scene.integrator, h), controllers.begin())
    first = resolved_start(model, scene.integrator, h).state
    state, memory = started(solver, scene.integrator, first)
    extents = Extents.from_model(model, solver.layout, solver.dictionaries)
    name = phase.removesuffix(" run")
    manager.hook.on_start(run=RunStart(
        scene.title, scene.reducer_name, 0.0, steps * h, steps, name))
    yield state
    taking = iterate(step, state, memory, steps)
    for n in range(1, steps + 1):
        with holding(controllers.held):
            taken = next(taking)
        outcome, state = taken.outcome, taken.state
        if not outcome.status.ok:
            where = f"{phase}: {outcome.detail}" if outcome.detail else phase
            manager.hook.on_failure(
                status=outcome.status, t=state.t + h, block=outcome.block, detail=where)
            manager.hook.on_finish(summary={"phase": name, "steps": n - 1})
            raise SolveFailed(outcome.status, state.t + h, outcome.block, where, phase=phase)
        if large := extents.exceeded(extents.sizes(state.x[None])[0]):
            manager.hook.on_finish(summary={"phase": name, "steps": n - 1})
            raise diverged(scene, model, offline, first, state, large, phase)
        yield state
        if manager.has_observers:
            manager.hook.on_step(step=n, t=state.t, x=state.x, outcome=outcome)
    manager.hook.on_finish(summary={"phase": name, "steps": steps})


def step_count(scene: Scene) -> int:
    """Number of steps of `time.step` up to `time.end`, rounded: remainders up to 1e-6 steps are
    accepted."""
    return round(scene.time.end / scene.time.step)


def snapshot_count(scene: Scene) -> int:
    """Number of snapshots of all training runs, with the additional one for integrators of an order
    above 1. Raises InputError for a training run that is not valid."""
    training = scene.for_training()
    each = step_count(training) // scene.training.every + 1 + int(scene.integrator.order > 1)
    return scene.training_runs * each
