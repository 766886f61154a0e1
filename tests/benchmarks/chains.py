"""Cost of a step as a chain grows: 5 to 100 bodies, rigid and flexible; loads; stored steps.

    python tests/benchmarks/chains.py [--quick] [--only rigid,full,galerkin,loads,stored] [--dense]
        [--out chains.json]

Pinned links in the plane that swing under gravity. A figure is the CPU time of one thread, the
median over windows of steps in which all lengths take turns. The exponent is that of a power law
fitted to all lengths, and `last` that between the two longest, where constant costs count least.
With --dense the Jacobians of all chains are dense matrices, for comparison.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core import ReducedProblem
from sparsemor.core.model.assembly import assemble
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.scene.scene import Scene, build
from sparsemor.core.scene.source import Source
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.simulation.training import offline_of
from sparsemor.reducers.step import jacobian_factors

BODIES, LOADS, STEPS = (5, 10, 20, 50, 100), (1, 3, 10, 30, 100), (2_000, 10_000, 50_000)
LENGTH, HEIGHT, STEP = 0.3, 0.03, 1e-3
MOST_BODIES, MOST_OTHER = 1.2, 1.1
"""Targets: largest exponents."""
GALERKIN = {"use": "galerkin", "basis": {"use": "modal", "count": 8}}

Tree = dict[str, Any]


def chain(count: int, flexible: bool) -> Tree:
    """A chain of pinned links that hangs at 0.3 rad from the vertical, at rest."""
    angle = -np.pi / 2 + 0.3
    along = LENGTH * np.array([np.cos(angle), np.sin(angle)])
    bodies, joints, before = {}, {}, "ground"
    for i in range(count):
        pose = {"position": [float(x) for x in i * along], "angle": angle}
        bodies[f"link{i}"] = {**(_bar() if flexible else _rod()), "pose": pose}
        joints[f"pin{i}"] = {"use": "revolute", "between": [before, f"link{i}:left"]}
        before = f"link{i}:right"
    return _scene(bodies, joints, {})


def pushed(count: int) -> Tree:
    """A rigid pendulum with so many oscillating forces on its end."""
    pushes = {f"push{i}": {
        "use": "point_force", "on": "rod:right", "force": [0.0, 1.0],
        "factor": {"use": "sine", "amplitude": 0.1, "frequency": 1.0 + i}} for i in range(count)}
    return _scene({"rod": _rod()}, {"pin": {
        "use": "revolute", "between": ["ground", "rod:left"]}}, pushes)


def _scene(bodies: Tree, joints: Tree, loads: Tree) -> Tree:
    weight = {"use": "gravity", "g": [0.0, -9.81]}
    return {"format": 1, "bodies": bodies, "joints": joints, "loads": {"weight": weight, **loads},
            "integrator": {"use": "generalized_alpha", "rho_inf": 0.8},
            "time": {"end": 1.0, "step": STEP}}


def _rod() -> Tree:
    return {"use": "rigid", "mass": 1.0, "inertia": LENGTH**2 / 12, "center": [LENGTH / 2, 0.0],
            "points": {"left": [0.0, 0.0], "right": [LENGTH, 0.0]}}


def _bar() -> Tree:
    """A flexible link of 320 triangles."""
    return {"use": "flexible", "fields": ["elastic"], "thickness": 0.03,
            "mesh": {"use": "rectangle", "lower": [0.0, -HEIGHT / 2], "size": [LENGTH, HEIGHT],
                     "divisions": [40, 4]},
            "material": {"E": 7e10, "nu": 0.3, "rho": 2700.0},
            "damping": {"stiffness": 1e-5}, "reference": {"clamp": "left"}}


def scene_of(tree: Tree, reducer: Any) -> Scene:
    return build(Source.of_tree({**tree, "reducer": reducer}))


def stepping(tree: Tree, reducer: Any) -> common.Stepping:
    """A solver at the start of its run."""
    scene = scene_of(tree, reducer)
    model = assemble(scene)
    solver = scene.reducer.prepare(ReducedProblem(
        model, scene.integrator, scene.time.step,
        offline_of(scene, model, Products(Cache()), new_manager()), np.random.default_rng(1)))
    return common.Stepping.begin(scene, model, solver)


def window(way: common.Stepping, steps: int) -> tuple[float, float]:
    """CPU ms per step, and iterations per step, of the next steps."""
    with common.no_collector():
        begun = time.process_time()
        iterations = sum(way.step()[1] for _ in range(steps))
        return 1e3 * (time.process_time() - begun) / steps, iterations / steps


def steps_of(
    counts: tuple[int, ...], make: Callable[[int], common.Stepping], steps: int, windows: int
) -> tuple[list[float], list[float], list[float]]:
    """Median CPU ms per step and mean iterations for each count, and CPU s until the first step."""
    ways, started = [], []
    for n in counts:
        begun = time.process_time()
        ways.append(make(n))
        started.append(time.process_time() - begun)
        report.progress(f"{n}: ready")
    for way in ways:
        window(way, min(steps, 10))
    taken = [[window(way, steps) for way in ways] for _ in range(windows)]
    found = np.array(taken)  # (windows, counts, 2)
    return np.median(found[:, :, 0], 0).tolist(), found[:, :, 1].mean(0).tolist(), started


def stored(steps: int) -> float:
    """CPU ms per step of a run that stores each step of a rigid pendulum."""
    tree = chain(1, False)
    tree["time"]["end"] = steps * STEP
    with tempfile.TemporaryDirectory() as folder:
        begun = time.process_time()
        simulate(scene_of(tree, "full"), out=Path(folder) / "run")
        return 1e3 * (time.process_time() - begun) / steps


def exponents(counts: tuple[int, ...], cost: list[float]) -> tuple[float, float]:
    """Exponent of a power law fitted to all costs, and that between the last two."""
    x, y = np.log(counts), np.log(cost)
    return float(np.polyfit(x, y, 1)[0]), float((y[-1] - y[-2]) / (x[-1] - x[-2]))


def fill(into: report.Report, given: argparse.Namespace) -> None:
    only = given.only.split(",")
    if given.dense:
        jacobian_factors.MANY = 10**9
    bodies, loads, lengths = (
        ((2, 4), (1, 3), (50, 100)) if given.quick else (BODIES, LOADS, STEPS))
    steps, windows = (3, 2) if given.quick else (30, 9)
    into.settings |= {
        "scene": f"links of {LENGTH:g} m, revolute joints, gravity, generalized_alpha, "
                 f"h = {STEP:g} s; flexible: 320 triangles; galerkin: 8 modes a link",
        "Jacobians": ("dense matrices" if given.dense
                      else f"sparse matrices from {jacobian_factors.MANY} unknowns on"),
        "windows": f"{windows} of {steps} steps, all counts in turn; median, CPU ms"}
    table = into.table("CPU milliseconds per step", ms=".4f", iterations=".2f", start_s=".2f")
    fits = into.table("Exponents of the cost of a step", fitted=".3f", last=".3f")
    cases: dict[str, tuple[tuple[int, ...], Callable[[int], common.Stepping], float]] = {
        "rigid": (bodies, lambda n: stepping(chain(n, False), "full"), MOST_BODIES),
        "full": (bodies, lambda n: stepping(chain(n, True), "full"), MOST_BODIES),
        "galerkin": (bodies, lambda n: stepping(chain(n, True), GALERKIN), MOST_BODIES),
        "loads": (loads, lambda n: stepping(pushed(n), "full"), MOST_OTHER)}
    for name, (counts, make, most) in cases.items():
        if name not in only:
            continue
        ms, iterations, started = steps_of(counts, make, steps, windows)
        for n, cost, its, start in zip(counts, ms, iterations, started, strict=True):
            table.add(case=name, count=n, ms=cost, iterations=its, start_s=start)
        fitted, last = exponents(counts, ms)
        fits.add(case=name, fitted=fitted, last=last)
        into.at_most(f"{name}: exponent of the cost of a step", fitted, most)
    if "stored" in only:
        stored(lengths[0] // 10)
        costs = [float(np.median([stored(n) for _ in range(3)])) for n in lengths]
        for n, cost in zip(lengths, costs, strict=True):
            table.add(case="stored steps", count=n, ms=cost)
        fitted, last = exponents(lengths, [n * c for n, c in zip(lengths, costs, strict=True)])
        fits.add(case="stored steps, whole run", fitted=fitted, last=last)
        into.at_most("stored steps: exponent of the cost of a run", fitted, MOST_OTHER)


if __name__ == "__main__":
    parser = report.options("chains", __doc__)
    parser.add_argument("--only", default="rigid,full,galerkin,loads,stored",
                        help="measure only these, separated by commas")
    parser.add_argument("--dense", action="store_true", help="dense matrices for all chains")
    sys.exit(report.run_plan("chains", fill, parser.parse_args()))
