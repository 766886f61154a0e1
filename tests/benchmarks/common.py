"""Runs of the double pendulum in memory, and their errors: what all benchmarks share.

Import it before NumPy: it limits linear algebra to one thread, which NumPy reads when it loads.
"""

import os
import sys

if "numpy" in sys.modules:
    raise ImportError("import common before numpy: the number of threads is set here")
os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sparsemor.core import ReducedProblem, State, StepSolver
from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.model.model import Model
from sparsemor.core.protocols.step_solver import ManySteps
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.time_stepping import (
    FixedStep,
    accepted_steps,
    iterate,
    many_steps,
    started,
)
from sparsemor.core.simulation.training import offline_of
from sparsemor.core.status import SolveFailed

LATE = 0.1
"""Elastic errors count from here on, s: before, the links still settle under their weight."""


def scene_at(elements: int, end: float, name: str = "double_pendulum", **changes: Any) -> Scene:
    """A packaged scene with this many triangles a link, trained over what is run, `end` s; with
    consistent capacity, whose snapshots span 30 displacements and 20 temperatures of a link."""
    return load(name, {
        "bodies.link1.capacity": "consistent", "bodies.link2.capacity": "consistent",
        "bodies.link1.mesh.elements": elements, "bodies.link2.mesh.elements": elements,
        "time.end": end, "training.end": end, **changes})


def galerkin(elastic: int | None = 30, thermal: int | None = 20) -> dict[str, Any]:
    """Reducer options: POD with at most so many atoms (None: down to the numerical rank)."""
    return {"use": "galerkin", **_bases(elastic, thermal)}


def sparse(
    rows: tuple[int, int], atoms: tuple[int | None, int | None] = (30, 20), *,
    active: tuple[int, int] | None = None, required: bool = True, **options: Any,
) -> dict[str, Any]:
    """Reducer options: plain rows; each pair is (elastic, thermal). active None: nothing is
    selected."""
    budgets = {f"*.{name}": {"rows": m} | ({} if active is None else {"atoms": active[i]})
               for i, (name, m) in enumerate(zip(("elastic", "thermal"), rows, strict=True))}
    return {"use": "sparse", "residual": "plain", **_bases(*atoms),
            "sampler": {"use": "lhs", "required": required},
            "preconditioner": "none", "budgets": budgets, **options}


def _bases(elastic: int | None, thermal: int | None) -> dict[str, Any]:
    def pod(count: int | None) -> dict[str, Any]:
        return {"use": "pod"} if count is None else {"use": "pod", "count": count}

    return {"basis": pod(elastic), "bases": {"*.thermal": pod(thermal)}}


@dataclass
class Stepping:
    """A solver on its way: it can be timed over a window of steps, and go on from there."""

    scene: Scene
    solver: StepSolver
    state: State
    memory: Any
    many: ManySteps | None = None
    fixed: FixedStep = field(init=False)
    """The integrator's rules for a step are made once, as in a run."""

    def __post_init__(self) -> None:
        self.fixed = FixedStep.of(self.scene.integrator, self.solver, self.scene.time.step)

    @classmethod
    def begin(cls, scene: Scene, model: Model, solver: StepSolver) -> "Stepping":
        """At the start; with compiled steps where the reducer has `compiled: on`."""
        state, memory = started(solver, scene.integrator, consistent_state(model))
        return cls(scene, solver, state, memory,
                   many_steps(solver, scene.integrator, scene.time.step, 0))

    def step(self) -> tuple[float, int]:
        """Seconds and iterations of one step, as `simulate` counts it: formula, solution, rates.

        Raises SolveFailed.
        """
        taken = next(accepted_steps(
            self.fixed, self.state, self.memory, 1, self.scene.time.step))
        self.state, self.memory = taken.state, taken.memory
        return taken.seconds, taken.outcome.iterations

    def take(self, steps: int) -> None:
        """Takes the next steps."""
        if self.many:
            self._together(steps)
        else:
            for _ in range(steps):
                self.step()

    def advance(self, steps: int) -> tuple[float, float]:
        """Median ms and mean iterations of the next steps."""
        with no_collector():
            taken = self._together(steps) if self.many else [self.step() for _ in range(steps)]
        seconds, iterations = zip(*taken, strict=True)
        return 1e3 * float(np.median(seconds)), float(np.mean(iterations))

    def _together(self, steps: int) -> list[tuple[float, int]]:
        """Seconds and iterations of steps that may be taken several at once."""
        found = []
        for taken in iterate(self.fixed, self.state, self.memory, steps, many=self.many):
            assert taken.outcome.status.ok
            self.state, self.memory = taken.state, taken.memory
            found.append((taken.seconds, taken.outcome.iterations))
        return found


@contextmanager
def no_collector() -> Iterator[None]:
    """Timed loops are not interrupted by the garbage collector."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Unknowns x (j, n) of `solver` from the start on, as far as it came.

    failure: why it stopped before its end, None if it did not. ms: median over steps. active:
    mean number of active atoms a block, where atoms are selected.
    """

    solver: StepSolver
    x: FloatArray
    ms: float
    iterations: float
    support_changes: int
    active: Mapping[str, float]
    failure: SolveFailed | None

    @property
    def rows(self) -> dict[str, int]:
        return {name: len(rows) for name, rows in self.solver.rows.items()}

    @property
    def atoms(self) -> dict[str, int]:
        return {name: d.atoms.shape[1] for name, d in self.solver.dictionaries.items()}

    @property
    def atoms_text(self) -> str:
        """Elastic/thermal, of the link that has more."""
        return "/".join(str(max(k for n, k in self.atoms.items() if n.endswith(field)))
                        for field in ("elastic", "thermal"))


def follow(scene: Scene, model: Model, solver: StepSolver, steps: int) -> Trajectory:
    """Run and keep every step; a failure is part of the answer."""
    way = Stepping.begin(scene, model, solver)
    x, taken = np.empty((steps + 1, solver.layout.size)), []
    x[0], failure = way.state.x, None
    active: dict[str, int] = {}
    with no_collector():
        for n in range(1, steps + 1):
            try:
                taken.append(way.step())
            except SolveFailed as error:
                failure = error
                break
            x[n] = way.state.x
            for name, support in solver.supports(way.memory).items():
                active[name] = active.get(name, 0) + int(support.sum())
    done, seconds = len(taken), [s for s, _ in taken] or [0.0]
    return Trajectory(
        solver, x[: done + 1], 1e3 * float(np.median(seconds)),
        sum(i for _, i in taken) / max(done, 1),
        solver.counters(way.memory).get("support_changes", 0),
        {name: total / max(done, 1) for name, total in active.items()}, failure)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A scene at one mesh with its full-order run: what all seeds are measured against.

    reference: block -> (steps + 1, n) unknowns of full order.
    """

    scene: Scene
    model: Model
    offline: Offline
    reference: Mapping[str, FloatArray]
    steps: int

    @classmethod
    def of(
        cls, scene: Scene, steps: int | None = None, model: Model | None = None
    ) -> "Case":
        """Training run through the cache; one training run and one basis serve every seed."""
        model = assemble(scene) if model is None else model
        offline = offline_of(scene, model, Products(Cache()), new_manager())
        count = steps or round(scene.time.end / scene.time.step)
        full = scene.using({"reducer": "full"})

        def moving() -> dict[str, FloatArray]:
            solver = full.reducer.prepare(ReducedProblem(
                model, full.integrator, full.time.step, offline, np.random.default_rng(0)))
            way = Stepping.begin(full, model, solver)
            names = [b.name for b in model.layout if b.field == "rigid"]
            kept = {n: [way.state.x[model.layout[n]]] for n in names}
            for _ in range(count):
                way.step()
                for n in names:
                    kept[n].append(way.state.x[model.layout[n]])
            return {n: np.array(rows) for n, rows in kept.items()}

        reference = dict(offline.remember("rigid motion", (count,), moving))
        reference |= {n: offline.snapshots(n).T[: count + 1] for n in model.reducible()}
        return cls(scene, model, offline, reference, count)

    def prepared(self, reducer: Mapping[str, Any] | str, seed: int = 1) -> StepSolver:
        """Raises SolveFailed where the sampled rows cannot tell the atoms apart."""
        scene = self.scene.using({"reducer": reducer})
        solver: StepSolver = scene.reducer.prepare(ReducedProblem(
            self.model, scene.integrator, scene.time.step, self.offline,
            np.random.default_rng(seed)))
        return solver

    def run(self, reducer: Mapping[str, Any] | str, seed: int = 1) -> Trajectory | SolveFailed:
        """A run with another choice of rows; SolveFailed where it could not even start."""
        try:
            solver = self.prepared(reducer, seed)
        except SolveFailed as error:
            return error
        return follow(self.scene, self.model, solver, self.steps)

    def errors(self, run: Trajectory) -> dict[str, float]:
        """Largest errors: angle (rad), elastic from LATE on, thermal, as `measure_errors` has them.

        A block's error is |x_ref - x|(t) over the largest |x_ref - x_ref(0)|; the worse link
        counts.
        """
        h = self.scene.time.step
        late = round(min(LATE, 0.5 * self.steps * h) / h)
        found = {"angle": 0.0, "elastic": 0.0, "thermal": 0.0}
        for b in self.model.layout:
            if b.field == "multiplier":
                continue
            truth = self.reference[b.name][: len(run.x)]
            if b.field == "rigid":
                angle = run.x[:, run.solver.layout[b.name]][:, 2] - truth[:, 2]
                found["angle"] = max(found["angle"], float(np.abs(angle).max()))
                continue
            series = self.series(b.name, run)
            series = series[late:] if b.field == "elastic" else series
            found[b.field] = max(found[b.field], float(series.max(initial=0.0)))
        return found

    def first_off(self, run: Trajectory, limit: float) -> str:
        """Where and when an error first exceeds `limit` (elastic: from LATE on)."""
        h = self.scene.time.step
        late = round(min(LATE, 0.5 * self.steps * h) / h)
        times = {}
        for name in run.solver.dictionaries:
            over = ~(self.series(name, run) <= limit)
            if name.endswith(".elastic"):
                over[:late] = False
            if over.any():
                times[name] = float(over.argmax()) * h
        if not times:
            return ""
        name = min(times, key=lambda n: times[n])
        return f"{name} at {times[name]:.3g} s"

    def series(self, name: str, run: Trajectory) -> FloatArray:
        """Error of a block at each time that the run reached."""
        whole, c = self.reference[name], run.x[:, run.solver.layout[name]]
        d = run.solver.dictionaries.get(name)
        error, size = np.zeros(len(c)), 0.0
        for first in range(0, len(whole), 64):
            truth = np.asarray(whole[first : first + 64])
            size = max(size, float(np.linalg.norm(truth - whole[0], axis=1).max()))
            part = c[first : first + 64]
            if len(part):
                x = part if d is None else d.offset + part @ d.atoms.T
                error[first : first + len(part)] = np.linalg.norm(x - truth[: len(part)], axis=1)
        return error / size


def in_words(failure: SolveFailed) -> str:
    """How a run stopped, in one phrase."""
    where = f" in {failure.block}" if failure.block else ""
    detail = f" ({failure.detail})" if failure.detail else ""
    return f"{failure.status.value}{where} at {failure.time:.3g} s{detail}"
