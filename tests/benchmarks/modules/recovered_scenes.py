"""The recovered scenes over their whole runs: errors of every field at many seeds, and cost.

Each packaged `*_recovered` scene at seeds 1, 2, ... in memory, against full order with the same
steps. The errors count from the start on: of a field relative to its largest change, as
`measure_errors` has them; `combined` is the paper's (Eq. 34). CPU times are taken afterwards, full
order and reduced steps in turn in one process.
"""

import argparse
import time
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core.arrays import FloatArray
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.rigid_stage import staged
from sparsemor.core.status import SolveFailed

LIMITS = {"double_pendulum": 1e-8, "slider_plate": 1e-4, "brake_disk": 1e-3}
QUICK = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
         "time.end": 0.06, "training.end": 0.06}
BETWEEN, ROUNDS = 10, 20
"""Steps between two looks at the clock, and how often each method has its turn."""


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scenes": "as packaged" + (", shortened" if given.quick else ""),
        "errors": "largest of the whole run, of a field relative to its largest change",
        "cost": f"CPU ms per step, median of {ROUNDS} turns of {BETWEEN} steps"}
    worst = out.table("Worst seed of each scene")
    cost = out.table("Cost of a step")
    for name in given.scene:
        case = case_of(f"{name}_recovered", QUICK if given.quick else {})
        own = case.scene.dump()["reducer"]
        table = out.table(f"{name}_recovered, {case.steps} steps")
        rows = []
        for seed in given.seeds:
            rows.append(row(case, own, seed))
            table.add(seed=seed, **rows[-1])
        errors = {k: max(r.get(k, np.inf) for r in rows)
                  for k in (*case.model.reducible(), "combined")}
        stopped = sum(r["status"] != "done" for r in rows)
        largest = max(errors[n] for n in case.model.reducible())
        worst.add(scene=name, seeds=len(rows), stopped=stopped, largest=largest,
                  combined=errors["combined"])
        if not given.quick:
            out.at_most(f"{name}: worst field of {len(rows)} seeds", largest, LIMITS[name])
        full, reduced = cpu_ms(case, own)
        cost.add(scene=name, full_ms=full, recovered_ms=reduced, ratio=full / reduced)


def case_of(name: str, changes: dict[str, Any]) -> common.Case:
    scene = load(name, changes)
    if scene.rigid_stage is None:
        return common.Case.of(scene)
    return common.Case.of(
        scene, model=staged(scene, Products(Cache()), new_manager(), BodyCache()))


def row(case: common.Case, reducer: dict[str, Any], seed: int) -> dict[str, Any]:
    begun = time.process_time()
    try:
        solver = case.prepared(reducer, seed)
    except SolveFailed as failure:
        return {"status": common.in_words(failure)}
    prepared, begun = time.process_time() - begun, time.process_time()
    run = common.follow(case.scene, case.model, solver, case.steps)
    mean = 1e3 * (time.process_time() - begun) / max(len(run.x) - 1, 1)
    found: dict[str, Any] = {n: float(case.series(n, run).max()) for n in case.model.reducible()}
    found |= {"combined": combined(case, run), "changes": run.support_changes, "ms": run.ms,
              "mean_cpu_ms": mean, "prepared_cpu_s": prepared,
              "status": "done" if run.failure is None else common.in_words(run.failure)}
    report.progress(f"seed {seed}: {found}")
    return found


def combined(case: common.Case, run: common.Trajectory) -> float:
    """Largest combined error (Eq. 34) at times with a reference that is not zero."""
    M = len(run.x)
    error, size = np.zeros(M), np.zeros(M)
    for b in case.model.layout:
        if b.field == "multiplier":
            continue
        truth, c = case.reference[b.name], run.x[:, run.solver.layout[b.name]]
        d = run.solver.dictionaries.get(b.name)
        for first in range(0, M, 64):
            at = slice(first, min(first + 64, M))
            x: FloatArray = c[at] if d is None else d.offset + c[at] @ d.atoms.T
            error[at] += np.sum((x - truth[at]) ** 2, axis=1)
            size[at] += np.sum(np.asarray(truth[at]) ** 2, axis=1)
    some = size > 0.0
    return float(np.sqrt(error[some] / size[some]).max())


def cpu_ms(case: common.Case, reducer: dict[str, Any]) -> tuple[float, float]:
    """CPU ms per step of full order and of a reducer, in turn."""
    ways = [common.Stepping.begin(case.scene, case.model, case.prepared(r))
            for r in ("full", reducer)]
    times: list[list[float]] = [[], []]
    rounds = min(ROUNDS, case.steps // (2 * BETWEEN))
    for way in ways:
        for _ in range(BETWEEN):
            way.step()
    for _ in range(rounds):
        for way, taken in zip(ways, times, strict=True):
            begun = time.process_time()
            for _ in range(BETWEEN):
                way.step()
            taken.append(1e3 * (time.process_time() - begun) / BETWEEN)
    return float(np.median(times[0])), float(np.median(times[1]))
