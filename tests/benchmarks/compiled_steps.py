"""Cost of a step of the packaged scenes, compiled and not, and what a step in Python calls.

    python tests/benchmarks/compiled_steps.py [--quick] [--out compiled_steps.json]

CPU time of windows of steps in turn, each with its own state, as packaged and with `galerkin` for
the double pendulum; --quick does not compile. `calls`, `products`: functions called and products
of small matrices in one step that is not compiled, counted by cProfile.
"""

import argparse
import cProfile
import sys
import time

import common
import numpy as np
import report

from sparsemor.core import ReducedProblem
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.prepare import prepared
from sparsemor.reducers.step.compiled.compile import installed

SCENES = {"double_pendulum": {"reducer.use": "galerkin"}, "slider_plate": {}, "brake_disk": {}}
WARM, STEPS, WINDOWS = 20, 100, 7
"""Steps before the first window, steps of a window, windows of each way."""
BRAKE_MS = 0.125 / 3.0
"""Target for brake_disk: a third of the cost in the first version (commit b8e4331)."""


def ways_of(scene: Scene, compiled: bool) -> dict[str, common.Stepping]:
    model, offline = prepared(scene, Cache(), new_manager(()))
    made = {}
    for option in ("off", "on") if compiled else ("off",):
        own = scene.using({"reducer.compiled": option})
        made[option] = common.Stepping.begin(own, model, own.reducer.prepare(ReducedProblem(
            model, own.integrator, own.time.step, offline, np.random.default_rng(own.seed))))
        made[option].take(WARM)
    return made


def timed(way: common.Stepping, steps: int) -> float:
    begun = time.process_time()
    way.take(steps)
    return (time.process_time() - begun) / steps * 1e3


def counted(way: common.Stepping, steps: int) -> tuple[float, float]:
    """Calls, and products of matrices, in one step."""
    profile = cProfile.Profile()
    profile.runcall(way.take, steps)
    counts = {str(entry.code): entry.callcount for entry in profile.getstats()}
    products = sum(n for code, n in counts.items() if "method 'dot'" in code)
    return sum(counts.values()) / steps, products / steps


def fill(out: report.Report, given: argparse.Namespace) -> None:
    table = out.table("CPU ms per step", ms=".3g", compiled=".3g", ratio=".2f", calls=".0f",
                      products=".0f")
    for name, options in SCENES.items():
        report.progress(name)
        short = {"time.end": 0.2, "training.end": 0.2, "bodies.link1.mesh.elements": 320,
                 "bodies.link2.mesh.elements": 320}
        scene = load(name, {**options, **(short if given.quick else {})})
        ways = ways_of(scene, installed() and not given.quick)
        ms: dict[str, list[float]] = {way: [] for way in ways}
        with common.no_collector():
            for _ in range(2 if given.quick else WINDOWS):
                for way, stepping in ways.items():
                    ms[way].append(timed(stepping, 20 if given.quick else STEPS))
        row = {way: float(np.median(series)) for way, series in ms.items()}
        calls, products = counted(ways["off"], 20)
        on = {"compiled": row["on"], "ratio": row["off"] / row["on"]} if "on" in row else {}
        table.add(scene=name, ms=row["off"], **on, calls=calls, products=products)
        if name == "brake_disk" and on:
            out.at_most("brake_disk, compiled ms", row["on"], BRAKE_MS)
        if given.quick:
            return


if __name__ == "__main__":
    sys.exit(report.run_plan("compiled_steps", fill, report.options(
        "compiled_steps", __doc__).parse_args()))
