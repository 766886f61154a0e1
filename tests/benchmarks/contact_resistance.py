"""CPU time of a step with a thermal contact resistance between two bodies, against one without.

    python tests/benchmarks/contact_resistance.py [--quick] [--out contact_resistance.json]

The resistance is a load of a third party (tests/third_party/sparsemor-sample) between the links of
the double pendulum. Runs with and without it take turns, window by window, so that both meet the
same machine.
"""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core.model.assembly import assemble
from sparsemor.core.scene.scene import Scene
from sparsemor.core.testing.in_memory_run import march

sys.path.append(str(Path(__file__).parents[1] / "third_party" / "sparsemor-sample"))
from thermal_contact import ContactResistance  # noqa: E402

CONDUCTANCE = 50.0
"""W/K"""
LIMIT = 1.3
"""Largest ratio of CPU time per step."""
REDUCERS: dict[str, Any] = {
    "full": "full", "galerkin": common.galerkin(30, 20),
    "sparse": common.sparse((240, 80))}


def linked(scene: Scene) -> Scene:
    """With the resistance between the links, at the joint that connects them."""
    gap = ContactResistance(between=("link1:bore_b", "link2:bore_a"), conductance=CONDUCTANCE)
    return scene.model_copy(update={"loads": {**scene.loads, "gap": gap}})


def begun(scene: Scene, snapshots: dict[str, Any]) -> common.Stepping:
    model = assemble(scene)
    solver = scene.reducer.prepare(common.ReducedProblem(
        model, scene.integrator, scene.time.step, common.Offline.of(model, snapshots),
        np.random.default_rng(scene.seed)))
    return common.Stepping.begin(scene, model, solver)


def window(way: common.Stepping, steps: int) -> float:
    """CPU time per step, ms."""
    with common.no_collector():
        start = time.thread_time()
        for _ in range(steps):
            way.step()
        return 1e3 * (time.thread_time() - start) / steps


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": f"double_pendulum, 2 x {given.elements} triangles, bdf1, h = 1 ms",
        "resistance": f"{CONDUCTANCE:g} W/K between link1:bore_b and link2:bore_a",
        "time": f"CPU time of the thread per step, median of {given.windows} windows of "
                f"{given.steps} steps in turn; ratio: median of the windows' ratios"}
    table = out.table("Contact resistance", without_ms=".3f", with_ms=".3f", ratio=".2f")
    end = given.trained * 1e-3
    plain = common.scene_at(given.elements, end, reducer="full")
    truth = march(linked(plain))
    snapshots = {n: truth.block(n).T for n in truth.model.reducible()}
    for name, options in REDUCERS.items():
        scene = plain.using({"reducer": options})
        ways = begun(scene, snapshots), begun(linked(scene), snapshots)
        for way in ways:
            window(way, given.steps)  # the first steps of a run take more iterations
        times = np.array([[window(way, given.steps) for way in ways]
                          for _ in range(given.windows)])
        ratio = float(np.median(times[:, 1] / times[:, 0]))
        without, with_it = np.median(times, axis=0).tolist()
        table.add(reducer=name, without_ms=without, with_ms=with_it, ratio=ratio)
        out.at_most(f"{name}: CPU time per step with the resistance, over that without", ratio,
                    LIMIT)
        report.progress(f"{name}: {table.rows[-1]}")


def arguments() -> argparse.Namespace:
    parser = report.options("contact_resistance", __doc__)
    parser.add_argument("--elements", type=int, default=1280)
    parser.add_argument("--trained", type=int, default=200, help="steps of the training run")
    parser.add_argument("--windows", type=int, default=9)
    parser.add_argument("--steps", type=int, default=40, help="steps of a window")
    given = parser.parse_args()
    if given.quick:
        given.elements, given.trained, given.windows, given.steps = 320, 40, 3, 5
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("contact_resistance", fill, arguments()))
