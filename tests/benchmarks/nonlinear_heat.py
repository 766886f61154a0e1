"""Nonlinear heat: cost of a step and errors of every reducer, in training and on an unseen load.

    python tests/benchmarks/nonlinear_heat.py [--quick] [--out nonlinear_heat.json]

A plate with k(T), or with k(T) and c(T), heated from above and cooled by a film from below; and the
radiating plate of docs/examples/radiating_plate.yaml. Reducers take turns, window by window, in CPU
time of one process; errors are relative to the largest change of temperature in the full-order run.
"""

import argparse
import sys
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.bodies.terms.weak_term import WeakTerm
from sparsemor.core import FloatArray, Trial
from sparsemor.core.model.assembly import assemble
from sparsemor.core.model.compressed_local import CompressedLocal
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.testing.in_memory_run import March, march, scene_of
from sparsemor.reducers.step.compiled.compiled_stepper import compilable, installed

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "radiating_plate.yaml"
STEEL_K = {"temperatures": [293.15, 1073.15, 1473.15], "values": [53.3, 27.3, 27.3]}
STEEL_C = {"temperatures": [293.15, 473.15, 673.15, 873.15], "values": [440, 530, 606, 760]}
"""Carbon steel, EN 1993-1-2:2005, 3.4.1.3 and 3.4.1.2: k is linear up to 800 degrees Celsius."""
TRAINED = {"use": "sine", "amplitude": 3e5, "frequency": 0.02, "offset": 3e5}
UNSEEN = {"use": "table", "times": [0.0, 20.0, 20.5, 45.0, 60.0],
          "values": [1e5, 5e5, 2e5, 4.5e5, 1e5]}
BY_ELEMENTS, COMPILED = "galerkin, by elements", ", compiled"
REDUCERS = ("galerkin", "lspg", "deim", "gnat", "ecsw", "sparse")
FULL_TO_ECSW, GALERKIN_TO_ECSW, FULL_TO_REDUCED = 60.0, 30.0, 3.0
TRAINING_ERROR, UNSEEN_ERROR = 1e-6, 1e-3


def plate(divisions: tuple[int, int], flux: Any, *, stored: bool, **changes: Any) -> Scene:
    return scene_of({
        "bodies": {"plate": {
            "use": "flexible", "thickness": 0.01, "fields": ["thermal"], "frame": "fixed",
            "mesh": {"use": "rectangle", "size": [0.2, 0.04], "divisions": list(divisions),
                     "diagonal": "alternating"},
            "material": {"rho": 7850, "k": STEEL_K, "c": STEEL_C if stored else 440}}},
        "loads": {"lamp": {"use": "heat_flux", "on": ["plate:top"], "flux": flux},
                  "film": {"use": "convection", "on": ["plate:bottom"], "film": 200.0,
                           "temperature": 293.15}},
        "time": {"end": 60.0, "step": 0.5}, **changes})


class ByElements(WeakTerm):
    """A weak term that projects its element-wise evaluation, without points."""

    def compress(self, trial: Trial, left: FloatArray) -> Any:
        return CompressedLocal.of(self, trial, left)


def by_elements(model: Model) -> Model:
    (heat,) = model.separated.heat
    local: Any = tuple(ByElements(*(getattr(t, f.name) for f in fields(t)))
                       for t in heat.local if isinstance(t, WeakTerm))
    return replace(model, separated=replace(
        model.separated, heat=(replace(heat, local=local),)))


def options(name: str, atoms: int) -> dict[str, Any]:
    found: dict[str, Any] = {"use": name, "basis": {"use": "pod", "count": atoms}}
    if name == "sparse":
        found |= {"sampler": "deim", "budgets": {"*": {"rows": 2 * atoms, "atoms": atoms}}}
    if name == "ecsw":
        found |= {"constant": "weighted", "tau": 1e-7}
    return found


def decoded(run: March) -> FloatArray:
    x, maps = run.block("plate.thermal"), run.solver.dictionaries
    return x if not maps else maps["plate.thermal"].offset + x @ maps["plate.thermal"].atoms.T


def error(run: March, reference: March) -> float:
    want = decoded(reference)
    return float(np.abs(decoded(run) - want).max() / np.abs(want - want[0]).max())


def measured(
    out: report.Report, title: str, scenes: tuple[Scene, Scene | None], atoms: int,
    given: argparse.Namespace,
) -> dict[str, dict[str, Any]]:
    """Table of one scene and its variation with an unseen load; rows by reducer."""
    trained, unseen = scenes
    model = assemble(trained)
    truth = march(trained.using({"reducer": "full"}), model=model)
    other = None if unseen is None else march(unseen.using({"reducer": "full"}))
    snapshots = {"plate.thermal": truth.block("plate.thermal").T}
    ways, rows = {}, dict[str, dict[str, Any]]()
    for name in ("full", *REDUCERS, BY_ELEMENTS):
        chosen = "full" if name == "full" else options(name.partition(",")[0], atoms)
        here = by_elements(model) if name == BY_ELEMENTS else model
        run = march(trained.using({"reducer": chosen}), model=here, snapshots=snapshots)
        rows[name] = {"reducer": name, "error": error(run, truth)}
        if name != BY_ELEMENTS and unseen is not None and other is not None:
            rows[name]["unseen_error"] = error(
                march(unseen.using({"reducer": chosen}), snapshots=snapshots), other)
        rows[name] |= {"elements": run.solver.elements_touched["plate.thermal"],
                       "iterations": float(np.mean(run.iterations))}
        if name == "ecsw":  # constant matrices are projected: only these are visited in a step
            rows[name]["elements"] = run.solver.facts["plate.thermal"]["local_elements_kept"]
        ways[name] = run.solver
        if name in REDUCERS[:-1] and installed() and not given.quick:
            ways[f"{name}{COMPILED}"] = compilable(run.solver, "on")
        report.progress(f"{title}, {name}: {rows[name]}")
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(given.windows):
        for name, solver in ways.items():
            way = common.Stepping.begin(trained, model, solver)
            way.take(2)  # the first of all compiles
            steps = max(1, min(given.steps, round(trained.time.end / trained.time.step)))
            with common.no_collector():
                start = time.process_time()
                way.take(steps)
                times[name].append(1e3 * (time.process_time() - start) / steps)
    ms = {name: float(np.median(t)) for name, t in times.items()}
    table = out.table(title, error=".1e", unseen_error=".1e", ms=".3f", full_to_this=".1f")
    for name in ms:
        row = rows.setdefault(name, {"reducer": name})
        row |= {"ms": ms[name], "full_to_this": ms["full"] / ms[name]}
        table.add(**row)
    return rows


def fill(out: report.Report, given: argparse.Namespace) -> None:
    columns, rows = given.divisions
    out.settings |= {
        "plate": f"{2 * columns * rows} triangles, bdf1, 120 steps, {given.atoms} POD atoms, "
                 "steel of EN 1993-1-2",
        "unseen": "another history of the flux, piecewise linear",
        "time": f"CPU time per step, median of {given.windows} windows in turn"}
    for stored, title in ((False, "k(T)"), (True, "k(T) and c(T)")):
        scenes = (plate((columns, rows), TRAINED, stored=stored),
                  plate((columns, rows), UNSEEN, stored=stored))
        found = measured(out, title, scenes, given.atoms, given)
        ecsw = found["ecsw"]
        out.at_least(f"{title}: full order over ecsw", ecsw["full_to_this"], FULL_TO_ECSW)
        for name in ("galerkin", BY_ELEMENTS):
            out.at_least(f"{title}: {name}, over ecsw", found[name]["ms"] / ecsw["ms"],
                         GALERKIN_TO_ECSW)
        if f"ecsw{COMPILED}" in found:
            out.at_least(f"{title}: galerkin over ecsw, both compiled", found[
                f"galerkin{COMPILED}"]["ms"] / found[f"ecsw{COMPILED}"]["ms"], GALERKIN_TO_ECSW)
        out.at_most(f"{title}: ecsw, error in training", ecsw["error"], TRAINING_ERROR)
        out.at_most(f"{title}: ecsw, error on the unseen load", ecsw["unseen_error"], UNSEEN_ERROR)
    for divisions in given.radiating:
        scene = load(EXAMPLE, {"bodies.plate.mesh.divisions": list(divisions)})
        title = f"Radiating plate, {2 * divisions[0] * divisions[1]} triangles"
        found = measured(out, title, (scene, None), 8, given)
        for name in REDUCERS:
            out.at_least(f"{title}: full order over {name}", found[name]["full_to_this"],
                         FULL_TO_REDUCED)


def arguments() -> argparse.Namespace:
    parser = report.options("nonlinear_heat", __doc__)
    parser.add_argument("--atoms", type=int, default=12)
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--steps", type=int, default=120, help="steps of a window")
    given = parser.parse_args()
    given.divisions, given.radiating = (160, 32), [(40, 10), (80, 20)]
    if given.quick:
        given.divisions, given.radiating = (20, 4), [(20, 5)]
        given.windows, given.steps, given.atoms = 1, 10, 6
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("nonlinear_heat", fill, arguments()))
