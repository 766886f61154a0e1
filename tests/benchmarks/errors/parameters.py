"""Reduced models of two boxes of parameters at random parameters that no training run had.

    python tests/benchmarks/errors/parameters.py [--quick] [--scenes NAME ..] [--count N] [--end S]

Boxes: double_pendulum with heat flux, start angle of the second link and gravity; slider_plate with
speed and friction. Training runs at the corners and the centre. Prints the worst error of each
field relative to its largest change, wall times of whole runs, and the number of runs after which
the reduced model was worth its preparation; then the CPU time of whole runs, medians of interleaved
ones. `--out FOLDER`: the rows of every run, one CSV file per scene.
"""

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from sparsemor import ReducedModel, load, parameter_test, reduce, simulate
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.scene.parameters_and_training_points import latin_hypercube, values_at

BOXES: dict[str, dict[str, Any]] = {
    "double_pendulum": {
        "loads.gravity.factor": 1.0,
        "parameters": {
            "flux": {"key": "loads.heating.flux", "range": [8.0e5, 1.2e6]},
            "angle": {"key": "bodies.link2.pose.angle", "range": [0.0, 0.2]},
            "gravity": {"key": "loads.gravity.factor", "range": [0.95, 1.05]}},
        "training.every": 5, "output.every": 20,
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 40},
                    "bases": {"*.thermal": {"use": "pod", "count": 30}}}},
    "slider_plate": {
        "parameters": {
            "speed": {"key": ["joints.drive.x.final", "bodies.slider.pose.velocity.0"],
                      "range": [0.8, 1.0]},
            "friction": {"key": "contacts.sole.friction.coefficient", "range": [0.15, 0.25]}},
        "training.every": 2, "output.every": 10,
        "reducer": {"use": "galerkin", "basis": {"use": "pod", "count": 200},
                    "bases": {"slider.*": {"use": "pod", "count": 100}}}}}
QUICK = {f"bodies.link{i}.mesh.elements": 320 for i in (1, 2)} | {
    "time.end": 0.06, "training.end": 0.06, "output.every": 1}


def main(given: argparse.Namespace) -> None:
    for name in ["double_pendulum"] if given.quick else given.scenes:
        end = {} if given.end is None else {"time.end": given.end, "training.end": given.end}
        model = reduce(load(name, {
            **BOXES[name], "training.parameters": {"choice": "corners"}, "check_stability": "off",
            **end, **(QUICK if given.quick else {})}))
        print(f"{name}: {model.size} unknowns, trained at {model.scene.training_runs} points",
              flush=True)
        cpu = measured(model)
        found = parameter_test(model, 2 if given.quick else given.count, progress=reported)
        print(found)
        print("CPU time of a whole run: " + ", ".join(f"{w} {s:.3g} s" for w, s in cpu.items()),
              flush=True)
        if given.out is not None:
            given.out.mkdir(parents=True, exist_ok=True)
            (given.out / f"{name}.csv").write_text(found.to_csv(), encoding="utf-8")


def reported(done: int, of: int) -> None:
    print(f"run {done} of {of}", file=sys.stderr)


def measured(model: ReducedModel, count: int = 2) -> dict[str, float]:
    """CPU time, s, of whole runs, each at a point of its own, so that no rigid-body pre-simulation
    is in the cache when this is first measured."""
    bodies, taken = BodyCache(), dict[str, list[float]]()
    points = latin_hypercube(model.scene.parameters, 2 * count, 7)
    for mine, other in zip(points[::2], points[1::2], strict=True):
        full = model.scene.using({**values_at(other), "reducer": "full"})
        ways: dict[str, Callable[[], object]] = {
            "reduced": partial(model.run, parameters=mine),
            "full order": partial(simulate, full, body_cache=bodies.of_bodies())}
        for way, do in ways.items():
            begun = time.process_time()
            do()
            taken.setdefault(way, []).append(time.process_time() - begun)
    return {name: median(values) for name, values in taken.items()}


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="tiny sizes: does it still work?")
    parser.add_argument("--scenes", nargs="+", choices=BOXES, default=list(BOXES))
    parser.add_argument("--count", type=int, default=50, help="random parameters of each box")
    parser.add_argument("--end", type=float, help="end of the runs, s")
    parser.add_argument("--out", type=Path, help="folder for the rows of every run")
    return parser.parse_args()


if __name__ == "__main__":
    main(arguments())
