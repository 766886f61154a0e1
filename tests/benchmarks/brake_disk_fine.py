"""Brake disk at 72 thousand tetrahedra: the recommended reducer, exact enough and how much faster.

    python tests/benchmarks/brake_disk_fine.py [--quick] [--refine 1.9] [--steps 240 | --whole]
        [--tabled 240] [--count 600] [--windows 15] [--full-steps 12] [--projections]
        [--out fine.json]

Full order and the packaged reducer, with as many thermal atoms as this mesh needs, are a process
each, as in scaling.py, and their windows of steps take turns. Errors are over all steps, start-up
included, against full order. Times are CPU time of one thread; `ahead`: ms that frames, loads and
tables take for each time, evaluated before the first step; `a step` has them in it.
Projections: what atoms miss of full order's states, before any equation is reduced.
"""

import argparse
import sys
from typing import Any

import common  # noqa: F401  one thread, before NumPy is loaded
import numpy as np
from modules import report
from scaling import Mesh, Worker, trained

from sparsemor.core.scene.scene import load


def recommended(tabled: int, count: int) -> dict[str, Any]:
    """The packaged reducer with so many shapes of the disk's heat, and atoms, for temperatures."""
    own: dict[str, Any] = load("brake_disk").dump()["reducer"]
    return {**own, "basis": {**own["basis"], "tabled": tabled, "count": count}}


PART, WHOLE = (240, 600), (240, 800)
"""Shapes and pulses that hold 1e-3 of the disk's temperatures on this mesh, over 240 steps and over
all 1200."""
SHAPES = 150, 240
PULSES = 400, 500, 600, 800, 1000
"""Of which `--projections` tells what they miss of the disk's temperatures."""


def fill(out: report.Report, given: argparse.Namespace) -> None:
    scene = load("brake_disk", {"bodies.disk.mesh.refine": given.refine})
    disk: Any = scene.bodies["disk"]
    cells = len(disk.mesh.build(None).cells)
    out.settings |= {
        "scene": f"brake_disk, bdf1, h = 1 ms, mesh.refine {given.refine:g} of disk and pad: the "
                 f"disk has {cells} tetrahedra",
        "steps": f"{given.steps} of the 1200",
        "recommended": f"as packaged, but basis.tabled {given.tabled} and basis.count "
                       f"{given.count} for the disk's temperatures; no training run",
        "ahead": "for each of the times of given motion and loads, all at once; median of repeats",
        "windows": f"{given.windows} of each, in turn: {given.full_steps} steps of full order, all "
                   "steps of the reduced model; medians of medians, CPU ms of one thread",
        "errors": "largest distance from full order over the largest change, whole run"}
    offline = out.table("Full order: wall seconds of what comes before, and its peak, GB")
    atoms = out.table("POD atoms for 1e-3: projection, by steps trained on")
    steps = out.table("Milliseconds a step", iterations=".2f")
    errors = out.table("Errors of the recommended reducer")
    mesh = Mesh(given.refine, "both", given.steps)
    if not trained(mesh, offline, atoms):
        return
    if given.projections:
        projected(out, mesh, given)
    workers = [Worker(mesh, "full", reducer="full")]
    try:
        workers.append(Worker(
            mesh, "recommended", reducer=recommended(given.tabled, given.count), errors=True))
        for _ in range(given.windows):
            for w, count in zip(workers, (given.full_steps, given.steps), strict=True):
                w.window(count)
    finally:
        for w in workers:
            w.end()
    for w in workers:
        timed = report.quantiles(w.ms) if w.ms else {}
        steps.add(method=w.method, ms=timed.get("median"), least=timed.get("least"),
                  most=timed.get("most"), ahead=w.facts.get("ahead_ms"),
                  a_step=counted(w) if w.ms else None, iterations=w.iterations or None,
                  solved=w.facts.get("reduced"),
                  prepare_s=w.facts.get("prepare_s"), peak=w.facts.get("peak"),
                  status=w.facts.get("failed", "done"))
    full, reduced = workers
    if full.ms and reduced.ms:
        found = reduced.facts["errors"]
        errors.add(**found)
        out.at_most("recommended: worst field", max(found.values()), 1e-3)
        ratios = [f / r for f, r in zip(full.ms, reduced.ms, strict=True)]
        out.remarks.append("times as fast, steps alone, window by window: " + ", ".join(
            f"{r:.0f}" for r in ratios))
        out.at_least("recommended: times as fast as full order, with what is evaluated ahead",
                     counted(full) / counted(reduced), 500.0)


def counted(w: Worker) -> float:
    """ms of a step, what is evaluated ahead for its time counted in."""
    return float(np.median(w.ms)) + float(w.facts["ahead_ms"])


def projected(out: report.Report, mesh: Mesh, given: argparse.Namespace) -> None:
    """Best approximations of the stored states, by block and by shapes and pulses."""
    shapes = sorted({*SHAPES, given.tabled} if given.refine > 1.0 else {given.tabled})
    counts = sorted({*PULSES, given.count} if given.refine > 1.0 else {given.count})
    w = Worker(mesh, "projections", reducer=recommended(given.tabled, given.count),
               tabled=shapes, counts=counts)
    w.end()
    table = out.table("Best approximation: as recommended")
    table.add(**w.facts.get("found", {"status": w.facts.get("failed")}))
    table = out.table("Best approximation: the disk's temperatures, by pulses")
    for name, found in w.facts.get("pulses", {}).items():
        table.add(shapes=name, **found)


def arguments() -> argparse.Namespace:
    parser = report.options("brake_disk_fine", __doc__)
    parser.add_argument("--refine", type=float, default=1.9)
    parser.add_argument("--steps", type=int, default=240)
    parser.add_argument("--whole", action="store_true", help="all 1200 steps of the scene")
    parser.add_argument("--tabled", type=int, help="shapes of the disk's heat")
    parser.add_argument("--count", type=int, help="pulses of them")
    parser.add_argument("--windows", type=int, default=15)
    parser.add_argument("--full-steps", type=int, default=12)
    parser.add_argument("--projections", action="store_true",
                        help="also what the atoms miss: some minutes more")
    given = parser.parse_args()
    enough = WHOLE if given.whole else PART
    given.steps = 1200 if given.whole else given.steps
    given.tabled, given.count = given.tabled or enough[0], given.count or enough[1]
    if given.quick:
        given.refine, given.steps, given.tabled, given.count = 0.4, 16, 16, 60
        given.windows, given.full_steps, given.projections = 2, 3, True
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("brake_disk_fine", fill, arguments()))
