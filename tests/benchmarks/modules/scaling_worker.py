"""One method on one mesh of the brake disk, in a process of its own: what it holds is its own.

`scaling.py` starts it with its task as JSON, and asks for windows of steps by lines on standard
input, so that the windows of several methods can take turns.
"""

import gc
import json
import sys
import time
from typing import Any

import common
import numpy as np
from modules.scaling_atoms import projections

from sparsemor.core import ReducedProblem, StepSolver
from sparsemor.core.arrays import FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.model.initial_state import consistent_state
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.memory.estimate import precheck_memory
from sparsemor.core.simulation.memory.limits import GIGABYTE, peak, resident
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.core.status import SolveFailed
from sparsemor.reducers.step.blockwise_solver import BlockwiseSolver
from sparsemor.reducers.step.reduced_mechanics import ReducedMechanics
from sparsemor.reducers.step.thermal_block import CompressedHeat
from sparsemor.reducers.step.time_tables import TimeTable

BASE = resident()
"""What the interpreter and its libraries hold."""
WARM = 6
"""Steps of full order before the first window: its predictor is full then."""


def scene_of(task: dict[str, Any]) -> Scene:
    """brake_disk at `refine`, both fields or heat alone, `steps` steps, trained on all of them."""
    end = round(task["steps"] * 1e-3, 9)
    fields = ["thermal"] if task["field"] == "heat" else ["elastic", "thermal"]
    bodies = {f"bodies.{b}.{key}": value for b in ("disk", "pad") for key, value in (
        ("mesh.refine", task["refine"]), ("fields", fields))}
    return load("brake_disk", {
        "time.end": end, "training.end": end, "check_stability": "off",
        "reducer": task["reducer"], **bodies, **task["changes"]})


def train(task: dict[str, Any]) -> dict[str, Any]:
    """Rigid stage, surface loads and training run, and the atoms of each block that hold its
    snapshots to `tolerance`: over all steps, their first half, quarter and eighth.

    Kept in the cache with the seconds and the peak of the process that made them.
    """
    scene = scene_of(task)
    model, offline = prepared(scene, Cache(), new_manager())
    names, steps = list(model.reducible()), task["steps"]

    def make() -> dict[str, Any]:
        offline.snapshots(names[0])
        held = peak()
        counts = [[atoms_for(offline.snapshots(n), steps >> j, task["tolerance"])
                   for j in range(4)] for n in names]
        return {"peak": np.array(held), "counts": np.array(counts)}

    made = offline.remember("scaling", (task["tolerance"],), make)
    offline.snapshots(names[0])
    spent: dict[str, float] = {}
    for product, seconds in offline.products.spent.seconds.items():
        kind = product.partition("/")[0]
        spent[kind] = spent.get(kind, 0.0) + seconds
    counts = np.asarray(made["counts"])
    return {"unknowns": {b.name: b.size for b in model.layout}, "spent": spent,
            "tetrahedra": sum(len(mesh.cells) for p in model.parts.values()
                              if (mesh := getattr(p, "mesh", None)) is not None),
            "peak": int(made["peak"]) / GIGABYTE,
            "counts": {n: row.tolist() for n, row in zip(names, counts, strict=True)}}


def atoms_for(S: FloatArray, steps: int, tolerance: float) -> int:
    """Fewest POD modes of the first columns of S (n, M), the start and `steps` more, that miss none
    by more than `tolerance` of the largest change. From the eigenvectors of S^T S: good to 1e-7 of
    the largest singular value."""
    M = steps + 1
    G = np.zeros((M, M))
    for rows in range(0, len(S), 4096):  # S may be on disk
        part = np.asarray(S[rows : rows + 4096, :M])
        part = part - part[:, :1]
        G += part.T @ part
    squares, V = np.linalg.eigh(G)
    share = np.maximum(squares, 0.0) * V**2  # (time, mode), modes from the least on
    missed = np.sqrt(np.cumsum(share, axis=1).max(axis=0) / G.diagonal().max())
    return int(M - np.searchsorted(missed, tolerance, side="right"))


class Way:
    """A prepared solver and the state that its windows start from."""

    def __init__(self, task: dict[str, Any]) -> None:
        self.task, self.scene = task, scene_of(task)
        self.full = task["reducer"] == "full"
        early, begun = precheck_memory(self.scene), time.process_time()
        model, offline = prepared(self.scene, Cache(), new_manager())
        before = time.process_time()
        self.solver: StepSolver = self.scene.reducer.prepare(ReducedProblem(
            model, self.scene.integrator, self.scene.time.step, offline,
            np.random.default_rng(1)))
        spent = time.process_time() - before
        self.start, self.memory = self.solver.start(consistent_state(model))
        self.start = self.scene.integrator.start(self.solver.layout, self.start)
        self.running: common.Stepping | None = None
        self.facts: dict[str, Any] = {
            "prepare_s": spent, "cpu_s": time.process_time() - begun,
            "reduced": self.solver.layout.size,
            "rows": sum(len(r) for r in self.solver.rows.values()),
            "elements": sum(self.solver.elements_touched.values()),
            "ahead_ms": ahead(self.solver)}
        if self.full:
            self.window(WARM)
            self.facts["solvers"] = {
                f.block: f"{f.solver} {f.memory / GIGABYTE:.2g} GB" for f in model.solvers.log
                if f.purpose == "steps"}
        elif task["errors"]:
            self.facts["errors"] = self.errors(offline)
        told = offline.expected
        assert told is not None and early is not None
        self.facts |= {"peak": peak() / GIGABYTE, "base": BASE / GIGABYTE, "told": told / GIGABYTE,
                       "foretold": early.total / GIGABYTE}

    def window(self, steps: int) -> dict[str, Any]:
        """CPU ms of each step, mean iterations; full order goes on, reduced models begin anew."""
        if self.running is None or not self.full:
            self.running = common.Stepping(
                self.scene, self.solver, self.start, self.memory.copy())
        taken, iterations = [], 0
        with common.no_collector():
            for _ in range(steps):
                begun = time.process_time()
                iterations += self.running.step()[1]
                taken.append(1e3 * (time.process_time() - begun))
        return {"ms": taken, "iterations": iterations / steps}

    def errors(self, offline: Offline) -> dict[str, float]:
        """Largest distance from the training run, of its largest change, by block."""
        way = common.Stepping(self.scene, self.solver, self.start, self.memory.copy())
        xs = [way.state.x]
        for _ in range(self.task["steps"]):
            way.step()
            xs.append(way.state.x)
        found = {}
        for name, d in self.solver.dictionaries.items():
            S, at = offline.snapshots(name), self.solver.layout[name]
            off = np.zeros(len(xs))
            size = np.zeros(len(xs))
            for j, x in enumerate(xs):
                truth = np.asarray(S[:, j])
                off[j] = np.linalg.norm(d.offset + d.atoms @ x[at] - truth)
                size[j] = np.linalg.norm(truth - S[:, 0])
            found[name] = float(off.max() / size.max())
        return found


def ahead(solver: StepSolver, repeats: int = 5) -> float:
    """CPU ms that what time alone decides takes for each time, which is done for all times before
    the steps: the median of some repeats."""
    if not isinstance(solver, BlockwiseSolver) or solver.mechanics is None:
        return 0.0
    known: list[TimeTable | None] = [
        *(h.prescribed for h in solver.heat.values()
                                   if isinstance(h, CompressedHeat))]
    if isinstance(solver.mechanics, ReducedMechanics):
        known += [b.table for b in solver.mechanics.equations.prescribed_bodies]
    asked = [(k.source, np.array(k.times)) for k in known if k is not None and k.rows is not None]
    spent = []
    for _ in range(repeats):
        spent.append(0.0)
        for source, times in asked:
            begun = time.process_time()
            source(times)
            spent[-1] += (time.process_time() - begun) / len(times)
    return 1e3 * float(np.median(spent))


def serve(task: dict[str, Any]) -> None:
    """Facts first; then a line of ms for each number of steps that is asked for."""
    way = Way(task)
    gc.collect()
    way.facts["resident"] = resident() / GIGABYTE
    tell(way.facts)
    for line in sys.stdin:
        tell(way.window(int(line)))


def tell(facts: dict[str, Any]) -> None:
    print(json.dumps(facts), flush=True)


if __name__ == "__main__":
    given = json.loads(sys.argv[1])
    try:
        with np.errstate(all="ignore"):
            if given["method"] == "training":
                tell(train(given))
            elif given["method"] == "projections":
                asked = scene_of(given)
                tell(projections(asked, *prepared(asked, Cache(), new_manager()),
                                 given["tabled"], given["counts"]))
            else:
                serve(given)
    except (SolveFailed, InputError) as failure:
        tell({"failed": str(failure)})
