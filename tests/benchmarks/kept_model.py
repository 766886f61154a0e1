"""Further runs of a kept reduced model against further full-order runs, in one process.

    python tests/benchmarks/kept_model.py [--quick] [--compiled] [--scenes NAME ..] [--out FILE]

CPU time of whole runs, the least of interleaved ones, with everything that a run includes. `beside
ms`: of a run whose steps are not computed but recorded ones; `other ms`: what a run with other
loads takes more; `open ms`: reading the model's file.
`--compiled`: runs with `reducer.compiled: on` as well, after one that compiles.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from itertools import count
from pathlib import Path
from shutil import rmtree
from typing import Any
from unittest.mock import patch

import numpy as np
from modules import report

from sparsemor import ReducedModel, Scene, load, load_model, simulate
from sparsemor.core.model.assembly import BodyCache
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.stages_before_steps import prepared_run
from sparsemor.core.simulation.time_stepping import TimeStep, in_blocks

RATIO = {"slider_plate": 10.0, "double_pendulum": 10.0, "brake_disk": 50.0}
"""Targets: full-order run over a run of the kept model."""
CLOCK = {"slider_plate": 20.0, "double_pendulum": 20.0, "brake_disk": 80.0}
"""Targets of the same by the wall clock, writing included, with machine code."""
BESIDE, OPEN, SIZE = 30.0, 200.0, 10.0
"""Targets: ms next to the steps, ms to open a file, MB of a file."""


def fill(into: report.Report, given: argparse.Namespace) -> None:
    scenes = {"double_pendulum": load("double_pendulum", {
        "bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320, "time.end": 0.05,
        "training.end": 0.05})} if given.quick else {name: load(name) for name in given.scenes}
    table = into.table("CPU time", full_s=".3g", kept_s=".3g", ratio=".3g", from_file=".3g",
                       beside_ms=".2g", other_ms=".2g", open_ms=".2g", file_mb=".3g",
                       compiled_s=".3g", compiled_ratio=".3g")
    clock = into.table("wall clock, writing included", full_s=".3g", compile_s=".3g", kept_s=".3g",
                       ratio=".3g", other_s=".3g", other_ratio=".3g")
    with tempfile.TemporaryDirectory() as place:
        for name, scene in scenes.items():
            report.progress(name)
            row = measured(scene, Path(place, f"{name}.model"), 2 if given.quick else 5)
            if given.compiled:
                row["compiled_s"] = compiled(scene, 2 if given.quick else 5)
                row["compiled_ratio"] = row["full_s"] / row["compiled_s"]
            table.add(scene=name, **row)
            wall = by_the_clock(scene, Path(place), name, 2 if given.quick else 9)
            clock.add(scene=name, **wall)
            into.at_least(f"{name}, full order over kept, wall clock", wall["ratio"], CLOCK[name])
            into.at_least(f"{name}, full order over kept", row["ratio"], RATIO[name])
            into.at_most(f"{name}, ms next to the steps", row["beside_ms"], BESIDE)
            into.at_most(f"{name}, ms to open", row["open_ms"], OPEN)
            into.at_most(f"{name}, MB", row["file_mb"], SIZE)


def measured(scene: Scene, file: Path, repeats: int) -> dict[str, float]:
    bodies, full = BodyCache(), scene.using({"reducer": "full"})
    simulate(full.using({"time.end": 2 * scene.time.step}), body_cache=bodies)
    run, _ = prepared_run(scene, Cache(), new_manager(()), bodies.of_bodies())
    model = ReducedModel(run)
    model.save(file)
    loaded, other = load_model(file), other_loads(model, scene)
    ways: dict[str, Callable[[], object]] = {
        "kept": model.run, "loaded": loaded.run, "other": lambda: model.run(other)}
    seconds: dict[str, float] = {}
    for _ in range(repeats):
        for way, do in ways.items():
            seconds[way] = min(seconds.get(way, np.inf), timed(do))
    whole = timed(lambda: simulate(full, body_cache=bodies))
    return {"full_s": whole, "kept_s": seconds["kept"], "ratio": whole / seconds["kept"],
            "from_file": whole / seconds["loaded"],
            "beside_ms": 1e3 * beside(model, 5 * repeats),
            "other_ms": 1e3 * (seconds["other"] - seconds["kept"]),
            "open_ms": 1e3 * min(timed(lambda: load_model(file)) for _ in range(repeats)),
            "file_mb": file.stat().st_size / 1e6}


def by_the_clock(scene: Scene, place: Path, name: str, repeats: int) -> dict[str, float]:
    """Wall time, s, of runs of the file of a model with results on disk: with its own loads, with
    others, and of full order."""
    model, bodies, full = load_model(place / f"{name}.model"), BodyCache(), scene.using(
        {"reducer": "full"})
    compiling, other, number = model.compile_steps(), other_loads(model, scene), count()

    def wall(do: Callable[[Path], object]) -> float:
        out = place / f"{name}{next(number)}"
        begun = time.perf_counter()
        do(out)
        seconds = time.perf_counter() - begun
        rmtree(out)
        return seconds

    simulate(full.using({"time.end": 2 * scene.time.step}), body_cache=bodies)
    own, others = list[float](), list[float]()
    for _ in range(repeats):
        own.append(wall(lambda out: model.run(out=out)))
        others.append(wall(lambda out: model.run(other, out=out)))
    whole = wall(lambda out: simulate(full, out=out, body_cache=bodies))
    return {"full_s": whole, "compile_s": compiling, "kept_s": min(own), "ratio": whole / min(own),
            "other_s": min(others), "other_ratio": whole / min(others)}


def other_loads(model: ReducedModel, scene: Scene) -> dict[str, object]:
    """The functions of time that a run may change, a tenth larger."""
    tree = scene.dump()["loads"]
    functions = {k: tree[k.split(".")[1]][k.split(".")[2]] for k in model.free if "loads" in k}
    return {k: {**f, "level": 1.1 * f["level"]} for k, f in functions.items()}


def compiled(scene: Scene, repeats: int) -> float:
    """CPU time, s, of a run of the kept model by machine code, once it is compiled."""
    run, _ = prepared_run(
        scene.using({"reducer.compiled": "on"}), Cache(), new_manager(()), BodyCache())
    model = ReducedModel(run)
    model.run()
    return min(timed(model.run) for _ in range(repeats))


def timed(do: Callable[[], object]) -> float:
    begun = time.process_time()
    do()
    return time.process_time() - begun


def beside(model: ReducedModel, repeats: int) -> float:
    """CPU time, s, of a run whose steps are not computed but those of an earlier run."""
    module, taken = import_module("sparsemor.core.simulation.run_steps"), list[Sequence[TimeStep]]()

    def recorded(*given: Any) -> Iterator[Sequence[TimeStep]]:
        for block in in_blocks(*given):
            taken.append(block)
            yield block

    with patch.object(module, "in_blocks", recorded):
        model.run()
    with patch.object(module, "in_blocks", lambda *given: iter(taken)):
        return min(timed(model.run) for _ in range(repeats))


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    parser = report.options("kept_model", __doc__)
    parser.add_argument("--scenes", nargs="+", choices=[*RATIO], default=[*RATIO], metavar="NAME")
    parser.add_argument("--compiled", action="store_true", help="run machine code as well")
    return parser.parse_args(given)


if __name__ == "__main__":
    sys.exit(report.run_plan("kept_model", fill, arguments()))
