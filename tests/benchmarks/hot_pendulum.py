"""The packaged hot_pendulum: errors of each field under flux histories that were not trained, cost
of a step, and cost of the reducer's own training.

    python tests/benchmarks/hot_pendulum.py [--elements 1280 20480] [--end 0.3] [--states DIR]
        [--reducers ecsw] [--set reducer.basis.count=100 reducer.tau=1e-5]

Full order and reduced models on one mesh after the other; the training run is full order under the
history of `training.overrides`. Errors are the largest over time and unknowns, relative to the
largest change of the field at full order. Steps are timed in CPU time of one process, in turns, all
along the run. At 20480 triangles per link a full-order run of 1 s takes ten minutes: --end shortens
all of them, --states keeps their states and element weights in a folder and uses them again.
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core import FloatArray, ReducedProblem, State
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.model import Model
from sparsemor.core.scene.digest import digest
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.time_stepping import started
from sparsemor.core.testing.in_memory_run import March, march
from sparsemor.reducers.step.compiled.compiled_stepper import compilable, installed

FLUX = "loads.heating.flux"
HISTORIES: dict[str, Any] = {
    "pulses": None,  # the scene's own
    "sine": {"use": "sine", "amplitude": 7e6, "frequency": 5.0, "offset": 7e6},
    "ramp": {"use": "table", "times": [0.0, 1.0], "values": [0.0, 1.4e7]}}
"""Histories of the flux in runs, W/m2; none of them is that of the training run."""
REDUCERS = ("galerkin", "ecsw")
ERROR, FULL_TO_BEST, FULL_TO_COMPILED = 1e-4, 25.0, 100.0


@dataclass(frozen=True)
class Case:
    """One mesh: scene, its full-order states by history, the snapshots (n, M) of its training run,
    and the folder in which reducers keep what they compute from these."""

    own: Scene
    model: Model
    states: Mapping[str, FloatArray]
    snapshots: Mapping[str, FloatArray]
    folder: Path

    def scene(self, history: str, **changes: Any) -> Scene:
        flux = HISTORIES[history]
        return self.own.using(changes if flux is None else {FLUX: flux, **changes})


def full_order(scene: Scene, folder: Path, name: str) -> FloatArray:
    """States (M, n) of the full-order run of a scene, from the folder if they are there."""
    kept = folder / f"{name}.npy"
    if kept.exists():
        return np.asarray(np.load(kept))
    report.progress(f"full order, {name}")
    x = march(scene.using({"reducer": "full"})).x
    folder.mkdir(parents=True, exist_ok=True)
    np.save(kept, x)
    return x


def case_of(elements: int, given: argparse.Namespace, folder: Path) -> Case:
    own = common.scene_at(elements, given.end, "hot_pendulum")
    own = own.using({key: json.loads(value) for key, value in given.set})
    model = assemble(own)
    name, end = f"{{}}_{elements}_{{}}", own.training.end or given.end
    steps, learnt = (round(t / own.time.step) for t in (given.end, end))
    trained = full_order(own.using({**own.training.overrides, "time.end": end}), folder,
                         name.format("training", learnt))
    case = Case(own, model, {}, {b: np.ascontiguousarray(trained[:, model.layout[b]].T)
                                 for b in model.reducible()}, folder)
    states = {h: full_order(case.scene(h), folder, name.format(h, steps)) for h in given.histories}
    return replace(case, states=states)


def errors(run: March, x: FloatArray) -> dict[str, float]:
    """Largest error of rigid coordinates, displacements and temperatures, each relative to the
    largest change of its field in the states x of full order."""
    layout, dictionaries = run.model.layout, run.solver.dictionaries
    found = {"rigid": 0.0, "elastic": 0.0, "thermal": 0.0}
    for block in layout:
        if block.field in found:
            want, here = x[:, layout[block.name]], run.block(block.name)
            if block.name in dictionaries:
                d = dictionaries[block.name]
                here = d.offset + here @ d.atoms.T
            error = float(np.abs(here - want).max() / np.abs(want - want[0]).max())
            found[block.field] = max(found[block.field], error)
    return found


def options(case: Case, name: str) -> dict[str, Any]:
    """A reducer with the bases of the scene."""
    packaged: dict[str, Any] = case.own.dump()["reducer"]
    return {**packaged, "constant": "weighted"} if name == "ecsw" else {
        "use": name, "basis": packaged["basis"], "bases": packaged.get("bases", {})}


def measured(
    out: report.Report, elements: int, given: argparse.Namespace, folder: Path
) -> None:
    case = case_of(elements, given, folder)
    title = f"2 x {elements} triangles"
    accuracy = out.table(f"{title}: errors", rigid=".1e", elastic=".1e", thermal=".1e")
    cost = out.table(f"{title}: cost", ms=".3f", full_to_this=".1f", offline_s=".1f")
    rows: dict[str, dict[str, Any]] = {"full": {"method": "full"}}
    solvers: dict[str, Any] = {"full": prepared(case, "full", case.own)[0]}
    largest = dict.fromkeys(given.reducers, 0.0)
    for name in given.reducers:
        solver, seconds = prepared(case, name, case.own)
        for history, x in case.states.items():
            scene = case.scene(history, reducer=options(case, name))
            other = HISTORIES[history] is not None
            run = march(scene, solver=prepared(case, name, scene)[0] if other else solver)
            found = errors(run, x)
            largest[name] = max(largest[name], *found.values())
            accuracy.add(reducer=name, history=history, **found)
            report.progress(f"{title}, {name}, {history}: {found}")
        solvers[name] = solver
        if installed() and not given.quick:
            solvers[f"{name}, compiled"] = compilable(solver, "on")
            rows[f"{name}, compiled"] = {"method": f"{name}, compiled"}
        facts = solver.facts.values()
        rows[name] = {
            "method": name, "elements": sum(solver.elements_touched[b] for b in case.snapshots),
            "in_step": sum(int(f.get("local_elements_kept", 0)) for f in facts) or None,
            "offline_s": seconds,
            "residual": max((float(f.get("residual", 0.0)) for f in facts), default=0.0)}
    for name, ms in timed(case, solvers, given).items():
        rows[name] |= {"ms": ms}
    full = rows["full"]["ms"]
    for row in rows.values():
        cost.add(**row, full_to_this=full / row["ms"])
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    out.remarks.append(f"{title}: at most {memory:.0f} MB in use")
    best = min(given.reducers, key=lambda name: rows[name]["ms"])
    out.at_most(f"{title}: {best}, largest error of a field", largest[best], ERROR)
    out.at_least(f"{title}: full order over {best}", full / rows[best]["ms"], FULL_TO_BEST)
    if f"{best}, compiled" in rows:
        out.at_least(f"{title}: full order over {best}, compiled",
                     full / rows[f"{best}, compiled"]["ms"], FULL_TO_COMPILED)


def prepared(case: Case, name: str, scene: Scene) -> tuple[Any, float]:
    """Step solver of a method for one history of the flux, and CPU seconds of its preparation.
    Weights of elements are those of the training run, whatever the history: they are kept."""
    scene = scene.using({"reducer": "full" if name == "full" else options(case, name)})
    model = case.model if scene.loads == case.own.loads else assemble(scene)
    offline = Offline(
        model, lambda: [(digest(case.snapshots), lambda: {
            b: s.T for b, s in case.snapshots.items()})], Products(Cache(case.folder)))
    begun = time.process_time()
    solver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step, offline, np.random.default_rng(scene.seed)))
    return solver, time.process_time() - begun


def timed(case: Case, solvers: Mapping[str, Any], given: argparse.Namespace) -> dict[str, float]:
    """Mean CPU ms per step of each method in the run of the first history, in turns. Reduced models
    take all its steps, in windows; full order, whose steps take longer the hotter the links are,
    `given.steps` from its own state in the middle of each window."""
    history, x = next(iter(case.states.items()))
    assert HISTORIES[history] is None or given.quick, "steps are timed in the scene's own history"
    h, length = case.own.time.step, (len(x) - 1) // given.windows
    times: dict[str, list[float]] = {name: [] for name in solvers}
    ways = {}
    for name, solver in solvers.items():
        common.Stepping.begin(case.own, case.model, solver).take(4)  # the first of all compiles
        ways[name] = common.Stepping.begin(case.own, case.model, solver)
    for window in range(given.windows):
        for name, way in ways.items():
            steps = length
            if name == "full":
                n, steps = window * length + length // 2, given.steps
                before, v = np.diff(x[n - 2 : n + 1], axis=0) / h  # those of bdf1
                way.state, way.memory = started(way.solver, case.own.integrator, State(
                    n * h, x[n], v, (v - before) / h, way.state.memory))
                way.take(4)
            with common.no_collector():
                start = time.process_time()
                way.take(steps)
                times[name].append(1e3 * (time.process_time() - start) / steps)
    return {name: float(np.mean(t)) for name, t in times.items()}


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "runs": f"bdf1, {given.end:g} s in steps of 1 ms",
        "reducer": "as packaged" + "".join(f", {key}: {value}" for key, value in given.set),
        "histories": ", ".join(given.histories),
        "time": f"CPU time per step, mean over the run, of {given.windows} windows in turn"}
    with tempfile.TemporaryDirectory() as scratch:
        for elements in given.elements:
            measured(out, elements, given, given.states or Path(scratch))


def arguments() -> argparse.Namespace:
    parser = report.options("hot_pendulum", __doc__)
    parser.add_argument("--elements", type=int, nargs="+", default=[1280])
    parser.add_argument("--set", type=lambda text: text.split("=", 1), nargs="+", default=[],
                        metavar="KEY=VALUE", help="changes of the scene, values in JSON")
    parser.add_argument("--reducers", nargs="+", choices=REDUCERS, default=list(REDUCERS))
    parser.add_argument("--end", type=float, default=1.0, help="end of all runs, s")
    parser.add_argument("--histories", nargs="+", choices=list(HISTORIES), default=list(HISTORIES))
    parser.add_argument("--states", type=Path, help="folder of full-order states and of weights")
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--steps", type=int, default=10, help="full-order steps of a window")
    given = parser.parse_args()
    if given.quick:
        given.elements, given.end, given.histories = [320], 0.02, ["sine"]
        given.windows, given.steps = 1, 2
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("hot_pendulum", fill, arguments()))
