"""Cost of a step of a reducer from another package beside that of `galerkin`.

    python tests/benchmarks/third_party_reducer.py [--quick] [--out third_party_reducer.json]

`oblique` of tests/third_party/sparsemor-sample is a Galerkin method with a test space of its own,
14 lines by public names. Both reducers have as many atoms and take turns on the same steps of the
double pendulum; a figure is the median CPU time of windows of steps.
"""

import argparse
import sys
import time
from pathlib import Path

import common
import numpy as np
from modules import report

from sparsemor.core import ReducedProblem
from sparsemor.core.protocols.plugin import Plugin

sys.path.insert(0, str(Path(__file__).parents[1] / "third_party" / "sparsemor-sample"))
from sparsemor_sample import Oblique

from sparsemor.reducers.projection.galerkin import Galerkin

MOST = 1.2
"""Target: cost of the third-party reducer relative to galerkin's."""
ATOMS = {"full": (30, 20), "quick": (8, 5)}


def contenders(elastic: int, thermal: int) -> dict[str, Plugin]:
    """Both reducers with equal trial bases; oblique tests with POD modes of weighted snapshots."""
    trial = {"basis": {"use": "pod", "count": elastic},
             "bases": {"*.thermal": {"use": "pod", "count": thermal}}}
    test = {"use": "pod", "weights": "inverse_sqrt_norm"}
    return {"galerkin": Galerkin.model_validate(trial),
            "oblique": Oblique.model_validate({**trial, "test": test})}


def stepping(case: common.Case, reducer: Plugin) -> common.Stepping:
    """One reducer at the start of the run."""
    scene = case.scene.using({"reducer": reducer})
    solver = scene.reducer.prepare(ReducedProblem(
        case.model, scene.integrator, scene.time.step, case.offline, np.random.default_rng(1)))
    return common.Stepping.begin(scene, case.model, solver)


def window(way: common.Stepping, steps: int) -> float:
    """CPU ms per step of the next steps."""
    with common.no_collector():
        begun = time.process_time()
        for _ in range(steps):
            way.step()
        return 1e3 * (time.process_time() - begun) / steps


def fill(into: report.Report, given: argparse.Namespace) -> None:
    elements, steps, repeats = (320, 5, 3) if given.quick else (1280, 100, 15)
    end = (10 + steps * repeats) * 1e-3
    case = common.Case.of(common.scene_at(elements, end), steps=1)
    atoms = ATOMS["quick" if given.quick else "full"]
    ways = {name: stepping(case, reducer) for name, reducer in contenders(*atoms).items()}
    for way in ways.values():
        window(way, 10)
    ms: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, way in ways.items():
            ms[name].append(window(way, steps))
    table = into.table("CPU milliseconds per step", ms=".4f", least=".4f", most=".4f")
    for name, way in ways.items():
        found = report.quantiles(ms[name])
        table.add(method=name, ms=found["median"], least=found["least"], most=found["most"],
                  atoms="/".join(str(d.atoms.shape[1]) for d in list(
                      way.solver.dictionaries.values())[::2]),
                  solver=type(way.solver).__name__)
    pairs = [a / b for a, b in zip(ms["oblique"], ms["galerkin"], strict=True)]
    into.at_most("oblique over galerkin, median of the windows", float(np.median(pairs)), MOST)


if __name__ == "__main__":
    sys.exit(report.run_plan("third_party_reducer", fill, report.options(
        "third_party_reducer", __doc__).parse_args()))
