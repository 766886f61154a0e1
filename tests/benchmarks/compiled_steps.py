"""Cost of a step of the packaged scenes, compiled and not, and what a step in Python calls.

    python tests/benchmarks/compiled_steps.py [--space] [--quick] [--out compiled_steps.json]

CPU time of windows of steps in turn, each with its own state, as packaged and with `galerkin` for
the double pendulum; --quick does not compile. With --space instead of these a flexible pendulum and
chains of five links in space, which swing from rest under gravity. `calls`, `products`: functions
called and products of small matrices in one step that is not compiled, counted by cProfile.
"""

import argparse
import cProfile
import sys
import time
from collections.abc import Iterator
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core import ReducedProblem
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene, build, load
from sparsemor.core.scene.source import Source
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.reducers.step.compiled.compiled_stepper import installed

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


def packaged(quick: bool) -> Iterator[tuple[str, Scene]]:
    short = {"time.end": 0.2, "training.end": 0.2, "bodies.link1.mesh.elements": 320,
             "bodies.link2.mesh.elements": 320}
    for name, options in SCENES.items():
        yield name, load(name, {**options, **(short if quick else {})})


def in_space() -> Iterator[tuple[str, Scene]]:
    yield "flexible pendulum", chain(1, "spherical", E=7e10)
    yield "5 rigid links, spherical", chain(5, "spherical")
    yield "5 rigid links, revolute", chain(5, "revolute")
    for E in (7e10, 1e9):
        yield f"5 flexible links, E {E:.0e} Pa", chain(5, "spherical", E=E)


def chain(count: int, joint: str, E: float = 0.0) -> Scene:
    """Horizontal links of 0.3 m, with axes of revolute joints in turn along y and z; flexible ones
    (E > 0) with 12 modes, three coordinates for each node of 20 x 2 x 2 cells."""
    bodies, joints, before = {}, {}, "ground"
    for i in range(count):
        link: dict[str, Any] = {
            "use": "rigid", "mass": 1.0, "inertia": [1e-3, 8e-3, 8e-3], "center": [0.15, 0.0, 0.0],
            "points": {"left": [0.0, 0.0, 0.0], "right": [0.3, 0.0, 0.0]}}
        if E > 0.0:
            link = {"use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
                    "mesh": {"use": "block", "lower": [0.0, -0.015, -0.015],
                             "size": [0.3, 0.03, 0.03], "divisions": [20, 2, 2]},
                    "material": {"E": E, "nu": 0.3, "rho": 2700.0}, "damping": {"stiffness": 1e-5}}
        bodies[f"link{i}"] = {**link, "pose": {"position": [0.3 * i, 0.0, 0.0]}}
        axis = {"axis": [0, 1, 0] if i % 2 else [0, 0, 1]} if joint == "revolute" else {}
        joints[f"pin{i}"] = {"use": joint, "between": [before, f"link{i}:left"], **axis}
        before = f"link{i}:right"
    reducer = {"use": "galerkin", "basis": {"use": "modal", "count": 12}} if E > 0.0 else {
        "use": "full"}
    return build(Source.of_tree({
        "format": 1, "bodies": bodies, "joints": joints, "reducer": reducer,
        "loads": {"weight": {"use": "gravity", "g": [0.0, -9.81, 1.0]}},
        "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
        "time": {"end": 1.0, "step": 1e-3}}))


def fill(out: report.Report, given: argparse.Namespace) -> None:
    table = out.table("CPU ms per step", ms=".3g", compiled=".3g", ratio=".2f", calls=".0f",
                      products=".0f")
    for name, scene in in_space() if given.space else packaged(given.quick):
        report.progress(name)
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
    parser = report.options("compiled_steps", __doc__)
    parser.add_argument("--space", action="store_true", help="bodies in space instead")
    sys.exit(report.run_plan("compiled_steps", fill, parser.parse_args()))
