"""Estimated and true errors of the packaged scenes and reducers, in training and outside it, and
the time that the estimate takes.

    python tests/benchmarks/errors/estimates.py [--scenes NAMES] [--every N] [--whole]
    python tests/benchmarks/errors/estimates.py --leaves TOLERANCE [--scenes NAME] [--whole]

One line per block: the largest error over the run relative to the block's largest change, the
estimate, and their quotient (effectivity); then the smallest and the largest quotient at one time,
over all stored times at which the error is above a hundredth of its maximum. The times are CPU
times of the same run in one process, with and without the estimate, in turns. With --leaves: a
source that moves on to where it never was in training (slider_plate or the scene that is named,
trained to half the time), and what the actions of the estimate make of it.
"""

import argparse
import statistics
import time
from collections.abc import Mapping
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sparsemor.core.errors import InputError
from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.simulation.simulate import simulate
from sparsemor.core.status import SolveFailed
from sparsemor.plugins.comparison.command import variants
from sparsemor.plugins.comparison.error_norms import Errors, measure_errors

HALF, OTHER = "to half the time", "with another load"
OUTSIDE = "run under another load"
CASES: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "double_pendulum": {
        "on the same run": {},
        HALF: {},
        OTHER: {"training.overrides": {"loads.heating.on": ["link1:bottom", "link2:bottom"]}},
    },
    "slider_plate": {
        "on the same run": {},
        HALF: {},
        OTHER: {"training.overrides": {"contacts.sole.friction.coefficient": 0.15}},
    },
    "brake_disk": {"on the same run": {}, HALF: {}},
    "hot_plate": {"on the same run": {"training": {}}, OTHER: {}},
    "hot_pendulum": {"on the same run": {"training": {}}, OTHER: {}},
    "double_pendulum_published": {"on the same run": {}},
    "double_pendulum_recovered": {"on the same run": {}, OUTSIDE: {
        "bodies.link2.pose.angle": 0.7853981633974483, "loads.heating.flux": 2e6,
        "training.overrides": {
            "bodies.link2.pose.angle": 0.08726646259971647, "loads.heating.flux": 1e6}}},
    "slider_plate_published": {"on the same run": {}},
    "slider_plate_recovered": {"on the same run": {}, HALF: {}, OUTSIDE: {
        "joints.drive.x.final": 0.8, "bodies.slider.pose.velocity": [0.8, 0.0],
        "contacts.sole.friction.coefficient": 0.15,
        "training.overrides": {
            "joints.drive.x.final": 1.0, "bodies.slider.pose.velocity": [1.0, 0.0],
            "contacts.sole.friction.coefficient": 0.2}}},
    "brake_disk_published": {"on the same run": {}},
    "brake_disk_recovered": {"on the same run": {}, OUTSIDE: {
        "bodies.disk.pose.spin": [0.0, 0.0, 44.444], "bodies.car.pose.spin": [0.0, 0.0, 44.444],
        "contacts.brake.friction.coefficient": 0.4,
        "training.overrides": {
            "bodies.disk.pose.spin": [0.0, 0.0, 66.667],
            "bodies.car.pose.spin": [0.0, 0.0, 66.667],
            "contacts.brake.friction.coefficient": 0.7}}},
}
"""Scene -> how the reduced model was trained -> settings. The bases of brake_disk need no training,
which only the forces of deim are taken from there. Runs under other loads are those of
docs/validation/recovery.md."""
COARSE = {f"bodies.link{i}.mesh.elements": 320 for i in (1, 2)}
SHORT: Mapping[str, Mapping[str, Any]] = {
    "double_pendulum": {**COARSE, "time.end": 0.4, "training.end": 0.4},
    "hot_pendulum": {**COARSE, "time.end": 0.1},
    "double_pendulum_recovered": {"time.end": 0.1, "training.end": 0.1},
    "slider_plate_recovered": {"time.end": 3.75e-4, "training.end": 3.75e-4},
    "brake_disk_recovered": {"time.end": 0.05, "training.end": 0.3},
    "double_pendulum_published": {"time.end": 0.01, "training.end": 0.1},
    "slider_plate_published": {"time.end": 1.875e-4, "training.end": 3.75e-4},
    "brake_disk_published": {"bodies.disk.mesh.refine": 0.65, "time.end": 0.02,
                             "training.end": 0.05},
}
"""Scene -> settings of a shorter run or a coarser mesh, where the whole run takes minutes; not with
--whole."""
PRODUCTS: Mapping[str, Mapping[str, Any]] = {
    f"{name}_published": {"reducer.preconditioner": {
        "use": "untf", "iterations": iterations, "products": 1}}
    for name, iterations in (("slider_plate", 20), ("brake_disk", 5))}
"""Published scenes with UNTF by one product: a step with exact eigenvectors takes up to a
minute."""
LINEAR, NONLINEAR = ("galerkin", "deim", "sparse"), ("galerkin", "deim", "ecsw", "sparse")
REPEATS = 3


def reduced(scene: Scene, reducer: str) -> Scene:
    """The scene with this reducer, and its own options where both have them; plain rows where
    `sparse` has none of its own."""
    other = "full" if reducer == scene.reducer_name else scene.reducer_name
    changed = variants(scene, [other, reducer])[reducer]
    if reducer == "ecsw":
        return changed.using({"reducer.constant": "weighted"})
    plain = reducer == "sparse" and changed.dump()["reducer"].get("residual", "auto") == "auto"
    return changed.using({"reducer.residual": "plain"}) if plain else changed


def reducers(name: str) -> tuple[str, ...]:
    """Reducers of a scene: the paper's runs have only their own."""
    if "_published" in name or "_recovered" in name:
        return ("sparse",)
    return NONLINEAR if name.startswith("hot") else LINEAR


def trained_as(name: str, training: str, short: Mapping[str, Any]) -> Scene:
    """A scene, shortened, that trains as the case says."""
    scene = load(name, {**CASES[name][training], **short, **PRODUCTS.get(name, {})})
    return scene.using({"training.end": scene.time.end / 2}) if training == HALF else scene


def full_order(name: str, training: str, short: Mapping[str, Any], out: str) -> RunResult:
    """The run that a case is measured by."""
    run = {k: v for k, v in CASES[name][training].items() if not k.startswith("training")}
    return simulate(load(name, {"reducer": "full", **run, **short}), out=out, keep_training=True)


def with_estimate(scene: Scene, every: int) -> Scene:
    return scene.using({"reducer.error_estimate": every})


def lines(training: str, reducer: str, e: Errors) -> list[str]:
    found = []
    for name in e.estimated:
        if name not in e.blocks:
            continue
        true, guess = e.series[name], e.estimated[name]
        shown = true > 0.01 * true.max()
        ratio = guess[shown] / true[shown]
        found.append(
            f"| {training} | {reducer} | {name} | {true.max():.1e} | {guess.max():.1e} | "
            f"{guess.max() / true.max():.2f} | {ratio.min():.2f} to {ratio.max():.2f} |")
    return found


def seconds(scene: Scene) -> float:
    """CPU seconds of a run."""
    with TemporaryDirectory() as folder:
        begun = time.process_time()
        simulate(scene, out=f"{folder}/run")
        return time.process_time() - begun


def cost(plain: Scene, every: int) -> str:
    """Milliseconds per step with and without estimate, medians of runs in turns; the difference of
    a run and one to half its time is that of their steps alone."""
    short = plain.using({"time.end": plain.time.end / 2})
    taken: dict[str, list[float]] = {"without": [], "with": []}
    steps = (plain.time.end - short.time.end) / plain.time.step
    for _ in range(REPEATS):
        for label, n in (("without", 0), ("with", every)):
            whole, part = (seconds(with_estimate(s, n)) for s in (plain, short))
            taken[label].append(1e3 * (whole - part) / steps)
    a, b = (statistics.median(taken[k]) for k in ("without", "with"))
    return f"{a:.3f} ms per step without the estimate, {b:.3f} with it ({b / a - 1.0:+.0%})"


def leaves(tolerance: float, name: str, short: Mapping[str, Any]) -> None:
    """Table of the actions: steps at full order, largest error, and CPU time of the run without
    its preparation."""
    full = simulate(load(name, {"reducer": "full", **short}), keep_training=True)
    scene = reduced(trained_as(name, HALF, short), reducers(name)[0])
    first = min(100 * scene.time.step, scene.time.end)
    simulate(scene.using({"time.end": first}))  # to fill the cache
    print("| action | ends at | full-order steps | largest error | quotient | CPU s |\n"
          "|---|---|---|---|---|---|", flush=True)
    for action in ("warn", "stop", "fall_back", "enrich"):
        asked = {"every": 5, "tolerance": tolerance, "action": action}
        begun = time.process_time()
        try:
            run = simulate(scene.using({"reducer.error_estimate": asked}))
        except SolveFailed as error:
            assert isinstance(error.result, RunResult)
            run = error.result
        spent, e = time.process_time() - begun, measure_errors(full, run)
        block = max(e.blocks & set(e.estimated), key=lambda name: e.worst[name])
        told = run.summary["fall_back"] or run.summary["enriched"] or {"steps": 0}
        first = [*run.summary["enriched"].get("times", []), told.get("time", run.times[-1])][0]
        print(f"| {action} | {run.times[-1]:.4g} s | {told['steps']} from {first:.4g} s, "
              f"{len(run.summary['enriched'].get('times', []))} times new atoms | "
              f"{e.worst[block]:.1e} {block} | "
              f"{e.effectivity[block]:.2f} | {spent:.1f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default=",".join(CASES))
    parser.add_argument("--trained", default="", help="only with such training, - for none")
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--whole", action="store_true", help="whole runs on the scenes' meshes")
    parser.add_argument("--cost", action="store_true", help="measure the time, too")
    parser.add_argument("--leaves", type=float, metavar="TOLERANCE", help="only the actions")
    asked = parser.parse_args()
    if asked.leaves is not None:
        chosen = "slider_plate" if asked.scenes == ",".join(CASES) else asked.scenes
        return leaves(asked.leaves, chosen, {} if asked.whole else SHORT.get(chosen, {}))
    with np.errstate(all="ignore"), TemporaryDirectory() as folder:
        for name in asked.scenes.split(","):
            short = {} if asked.whole else SHORT.get(name, {})
            print(f"\n{name}\n\n| trained | reducer | block | error | estimate | quotient | at one "
                  "time |\n|---|---|---|---|---|---|---|", flush=True)
            for training in CASES[name]:
                if asked.trained not in training:
                    continue
                reference = full_order(name, training, short, f"{folder}/{name} {training}")
                for reducer in reducers(name):
                    try:
                        scene = with_estimate(
                            reduced(trained_as(name, training, short), reducer), asked.every)
                        run = simulate(scene)
                    except InputError as error:
                        print(f"| {training} | {reducer} | refused: {error} | | | | |", flush=True)
                        continue
                    except SolveFailed as error:
                        print(f"| {training} | {reducer} | {error.status.value} at {error.time:g} "
                              "s; up to there: | | | | |", flush=True)
                        assert isinstance(error.result, RunResult)
                        run = error.result
                    print("\n".join(lines(training, reducer, measure_errors(reference, run))),
                          flush=True)
            if asked.cost:
                first = reducers(name)[0]
                scene = reduced(load(name, dict(short)), first)
                print(f"\n{first}: {cost(scene, asked.every)}", flush=True)


if __name__ == "__main__":
    main()
