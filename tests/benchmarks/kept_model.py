"""Further runs of a kept reduced model against further full-order runs, in one process:
`python tests/benchmarks/kept_model.py [SCENE ...]`.

Least of interleaved runs, in CPU time, with everything that a run includes. `beside the steps`: a
run less its time loop alone; `open`: reading the model's file.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np

from sparsemor import ReducedModel, load, load_model, simulate
from sparsemor.core.model.body_cache import BodyCache
from sparsemor.core.registry.hooks import new_manager
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.offline import step_count
from sparsemor.core.simulation.prepare import PreparedRun, prepared_run
from sparsemor.core.simulation.step_control import step_of
from sparsemor.core.simulation.time_stepping import iterate, started

SCENES = ("double_pendulum", "slider_plate", "brake_disk")
REPEATED = 3


def seconds(do: Callable[[], object]) -> float:
    begun = time.process_time()
    do()
    return time.process_time() - begun


@np.errstate(all="ignore")
def steps_alone(run: PreparedRun) -> None:
    integrator = run.scene.integrator
    step = step_of(run.solver, integrator, run.scene.time.step)
    for _ in iterate(step, *started(run.solver, integrator, run.start), step_count(run.scene)):
        pass


def measured(name: str, folder: Path) -> list[str]:
    scene, bodies, file = load(name), BodyCache(), folder / f"{name}.model"
    full = scene.using({"reducer": "full"})
    simulate(full.using({"time.end": 2 * scene.time.step}), body_cache=bodies)
    run, _ = prepared_run(scene, Cache(), new_manager(), bodies.of_bodies())
    model = ReducedModel(run)
    model.save(file)
    opened = median(seconds(lambda: load_model(file)) for _ in range(REPEATED))
    loaded = load_model(file)
    changed = {k: scene.dump()["loads"][k.split(".")[1]][k.split(".")[2]] for k in model.free
               if k.startswith("loads.")}
    changed = {k: {**v, "level": 1.1 * v["level"]} for k, v in changed.items()}
    for warm in (model.run, loaded.run, lambda: model.run(changed)):
        warm()
    times: dict[str, list[float]] = {"kept": [], "loaded": [], "changed": [], "steps": []}
    for _ in range(REPEATED):
        times["kept"].append(seconds(model.run))
        times["loaded"].append(seconds(loaded.run))
        times["changed"].append(seconds(lambda: model.run(changed)))
        times["steps"].append(seconds(lambda: steps_alone(run)))
    whole = seconds(lambda: simulate(full, body_cache=bodies))
    kept, again, other, alone = (min(t) for t in times.values())
    return [name, f"{whole:.2f}", f"{kept:.3f}", f"{whole / kept:.1f}", f"{whole / again:.1f}",
            f"{1e3 * (kept - alone):.0f}", f"{1e3 * (other - alone):.0f}", f"{opened:.3f}",
            f"{file.stat().st_size / 1e6:.2f}"]


if __name__ == "__main__":
    print("scene, full s, kept s, ratio, ratio loaded, beside the steps ms, with other loads ms, "
          "open s, file MB")
    with tempfile.TemporaryDirectory() as place:
        for scene_name in sys.argv[1:] or SCENES:
            print(", ".join(measured(scene_name, Path(place))), flush=True)
