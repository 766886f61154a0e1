"""Between the time loop and the store: buffers steps, evaluates probes, sums up a run."""

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from sparsemor.core.acting import acting_of, resultants
from sparsemor.core.arrays import BoolArray
from sparsemor.core.checkpoint import Checkpoint
from sparsemor.core.errors import InputError
from sparsemor.core.initial import start_notes
from sparsemor.core.model import Model
from sparsemor.core.notes import Level, Note, information, kinds, sentences
from sparsemor.core.offline import Offline
from sparsemor.core.plain import finite
from sparsemor.core.probes import ProbeReader
from sparsemor.core.protocols import State, StepSolver
from sparsemor.core.run_header import BodyShape, RunHeader
from sparsemor.core.scene import Scene
from sparsemor.core.served import Held, solvers_summary
from sparsemor.core.status import Status
from sparsemor.core.store import ChunkOfSteps, ResultWriter

STORE = "result.zarr"
CHUNK, SECONDS = 256, 2.0
"""Rows, or seconds, after which what was computed is committed to disk."""
BUFFER = 2**26
"""Bytes of rows after which it is, too."""


@dataclass
class Tally:
    """Sums over a run that outlive an interruption. Seconds are wall time."""

    offline: float = 0.0
    online: float = 0.0
    done: int = 0
    seconds: list[float] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)
    active: dict[str, int] = field(default_factory=dict)

    @property
    def last(self) -> float:
        return self.seconds[-1]

    def add(self, seconds: float, iterations: int) -> None:
        self.done += 1
        self.seconds.append(seconds)
        self.iterations.append(iterations)

    def count_atoms(self, supports: Mapping[str, BoolArray]) -> None:
        for name, support in supports.items():
            self.active[name] = self.active.get(name, 0) + int(np.count_nonzero(support))


class Recorder:
    """Owns the store of one run."""

    def __init__(
        self, scene: Scene, model: Model, solver: StepSolver, offline: Offline,
        writer: ResultWriter, checkpoint: Checkpoint | None, steps: int,
    ) -> None:
        self.scene, self.model, self.solver, self.offline = scene, model, solver, offline
        self.writer, self.checkpoint, self.steps = writer, checkpoint, steps
        self.store = writer.path
        self.reducer = str(scene.dump()["reducer"]["use"])
        self._probes = [ProbeReader.of(p, solver.layout, solver.dictionaries)
                        for p in model.probes]
        self._given = {n: shape for n, shape in shapes(model).items() if shape.given}
        self.notes: tuple[Note, ...] = ()  # of what was found before the first step
        self.stability: Mapping[str, Any] = {}
        self.memory: Held | None = None
        self._every, self._saved = scene.output.every, time.perf_counter()
        # along a rigid stage histories are kept already; what acts besides is conduction alone
        self._tells = model.stage is None
        self._rows: list[tuple[float, Any, int, float]] = []
        self._contacts: list[Mapping[str, float]] = []
        self._supports: list[Mapping[str, BoolArray]] = []

    @classmethod
    def open(
        cls, scene: Scene, model: Model, solver: StepSolver, offline: Offline, out: Path,
        resume: bool, steps: int,
    ) -> "Recorder":
        """A new store, or the stopped one. Raises InputError when there is one already."""
        store = out / STORE
        if resume:
            writer, checkpoint = ResultWriter.resume(store, scene.digest())
            return cls(scene, model, solver, offline, writer, checkpoint, steps)
        admit(scene, out, resume)
        out.mkdir(parents=True, exist_ok=True)
        header = _header(scene, model, solver, steps)
        return cls(scene, model, solver, offline, ResultWriter.create(store, header), None, steps)

    def restored(self, fresh: Tally) -> tuple[State, Any, Tally]:
        """State, step memory and sums at the last checkpoint."""
        assert self.checkpoint is not None
        a = self.checkpoint.arrays
        memory, tally = self.checkpoint.memory
        tally.offline += fresh.offline
        return State(float(a["t"]), a["x"], a["v"], a["a"], a["memory"]), memory, tally

    def start(self, state: State, supports: Mapping[str, BoolArray], memory: Any) -> None:
        self._keep(state, 0, 0.0, supports, memory)

    def take(
        self, state: State, tally: Tally, supports: Mapping[str, BoolArray], memory: Any
    ) -> bool:
        """Keep an accepted step when it is one to store; True when it is time to save."""
        if tally.done % self._every and tally.done != self.steps:
            return False
        self._keep(state, tally.iterations[-1], tally.last, supports, memory)
        return (len(self._rows) >= CHUNK or len(self._rows) * state.x.nbytes >= BUFFER
                or time.perf_counter() - self._saved > SECONDS)

    def keep_last(
        self, state: State, tally: Tally, supports: Mapping[str, BoolArray], memory: Any
    ) -> None:
        """Commit everything up to the last accepted step, also where it is none to store."""
        if tally.done % self._every:
            self._keep(state, tally.iterations[-1], tally.last, supports, memory)
        self.flush()

    def _keep(
        self, state: State, iterations: int, seconds: float, supports: Mapping[str, BoolArray],
        memory: Any,
    ) -> None:
        self._rows.append((state.t, state.x, iterations, seconds))
        self._supports.append(dict(supports))
        told = acting_of(self.solver, memory) if self._tells else ()
        self._contacts.append(resultants(told, state))

    def save(self, state: State, memory: Any, tally: Tally) -> None:
        """Commit the buffered steps and a checkpoint."""
        self.flush()
        arrays = {"t": np.array(state.t), "x": state.x, "v": state.v, "a": state.a,
                  "memory": state.memory}
        self.writer.checkpoint(arrays, (memory, tally))
        self._saved = time.perf_counter()

    def flush(self) -> None:
        if not self._rows:
            return
        t, x, iterations, seconds = (list(c) for c in zip(*self._rows, strict=True))
        X = np.stack(x)
        times = np.array(t)
        supports = {name: np.stack([s[name] for s in self._supports])
                    for name in self._supports[0]}
        self.writer.append(ChunkOfSteps(
            times, X, np.array(iterations), np.array(seconds), supports,
            {p.name: p(times, X) for p in self._probes},
            {name: np.array([c[name] for c in self._contacts]) for name in self._contacts[0]},
            {body: shape.given_at(times) for body, shape in self._given.items()}))
        self._rows, self._supports, self._contacts = [], [], []

    def finish(self, status: Status, summary: Mapping[str, Any]) -> None:
        self.writer.finish(status, summary)

    def summary(
        self, status: Status, tally: Tally, state: State, memory: Any
    ) -> dict[str, Any]:
        """The `--json` object of a run that came to `state`."""
        end, x = np.array([state.t]), state.x[None]
        solver, counters = self.solver, self.solver.counters(memory)
        atoms = {n: int(d.atoms.shape[1]) for n, d in solver.dictionaries.items()}
        done = max(tally.done, 1)
        return {
            "status": status.value,
            "scene": self.scene.name,
            "reducer": self.reducer,
            "steps": tally.done,
            "t_end": tally.done * self.scene.time.step,  # state.t is a long sum
            "wall_s": {"offline": tally.offline, "online": tally.online},
            "ms_per_step": 1e3 * float(np.median(tally.seconds)) if tally.seconds else 0.0,
            "newton_iterations": float(np.mean(tally.iterations)) if tally.iterations else 0.0,
            "factorizations": counters.get("factorizations", 0),
            "support_changes": counters.get("support_changes", 0),
            "rows": {n: len(r) for n, r in solver.rows.items()},
            "atoms": atoms,
            "atoms_active": {n: tally.active[n] / done if n in tally.active else float(k)
                             for n, k in atoms.items()},
            "elements_touched": dict(solver.elements_touched),
            "probes": {p.name: p.described(p(end, x)[0]) for p in self._probes},
            "cache": dict(self.offline.products.used),
            "offline_s": dict(self.offline.products.seconds),
            "offline_whole_s": self.offline.products.spent.whole(tally.offline),
            **told((*start_notes(self.model), *solver.notes, *self.notes,
                    *_full_newton(counters, done))),
            "stability": dict(self.stability),
            "linear_solvers": solvers_summary(
                [*self.model.solvers.log, *self.offline.products.told],
                _iterations(solver, memory), done),
            "memory": {} if self.memory is None else self.memory.summary(),
            "facts": finite(dict(solver.facts)),  # dependent columns: no finite condition
            "out": str(self.store.parent),
        }


def told(notes: Sequence[Note]) -> dict[str, list[str]]:
    """Notes in a summary: sentences of warnings, their kinds, and sentences of information."""
    return {"notes": sentences(notes, Level.WARNING), "note_kinds": kinds(notes),
            "information": sentences(notes, Level.INFORMATION)}


def _full_newton(counters: Mapping[str, int], steps: int) -> tuple[Note, ...]:
    """Of steps in which the iteration with constant operators did not converge."""
    n = counters.get("full_newton_steps", 0)
    return () if not n else (information(
        f"{n} of {steps} steps were solved by Newton's method with the exact Jacobian, because the "
        "iteration with constant operators did not converge: large displacements of a soft body "
        "are the usual cause", "full_newton"),)


def _iterations(solver: Any, memory: Any) -> Mapping[str, int]:
    """Of linear solvers in the steps, by block."""
    told = getattr(solver, "linear_iterations", None)
    return {} if told is None else dict(told(memory))


def admit(scene: Scene, out: Path, resume: bool) -> None:
    """Raises InputError when a run may not write to `out`: asked before anything is computed."""
    store = out / STORE
    if resume:
        ResultWriter.resumable(store, scene.digest())
        return
    if store.exists():
        raise InputError(f"{out} already holds a result: continue it with --resume, replace "
                         "it with --force, or name another directory", "out")
    place = out
    while not place.exists():
        place = place.parent
    if not place.is_dir() or not os.access(place, os.W_OK):
        raise InputError(f"{out}: nothing can be written to {place}: name another directory", "out")


def shapes(model: Model) -> dict[str, BodyShape]:
    """The shape of each body that has a mesh."""
    return {n: shape for n, p in model.parts.items()
            if hasattr(p, "shape") and (shape := p.shape()) is not None}


def _header(scene: Scene, model: Model, solver: StepSolver, steps: int) -> RunHeader:
    from importlib.metadata import entry_points

    names = {"sparsemor", "numpy", "scipy", "scikit-fem", "pydantic"}
    found = entry_points()
    for group in (g for g in found.groups if g.startswith("sparsemor.")):
        names |= {e.dist.name for e in found.select(group=group) if e.dist is not None}
    import platform

    dump = scene.dump()
    return RunHeader(
        scene=dump, scene_digest=scene.digest(), seed=scene.seed,
        versions={"python": platform.python_version()} | {n: version(n) for n in sorted(names)},
        reducer=str(dump["reducer"]["use"]), layout=solver.layout, full_layout=model.layout,
        step=scene.time.step, steps_planned=steps, dictionaries=solver.dictionaries,
        rows=solver.rows,
        bodies=shapes(model),
        probes=tuple(ProbeReader.of(p, solver.layout, solver.dictionaries).header()
                     for p in model.probes),
        budgets=dump["reducer"].get("budgets", {}), stage=model.stage,
        contacts={a.name: a.term.histories for a in acting_of(solver, None)}
        if model.stage is None else {},
    )
