"""Steps of a nonlinear scene as its mesh grows: heat in `hot_plate`, all meshes in one process.

k(T) and c(T) of two steels and radiation are evaluated in every iteration, by the hyper-reduced
methods on a few points or elements. `gnat` has as many rows on each mesh, whose triangles coincide
on coarse ones; beside it the number of triangles is the same on each mesh. Windows of all methods
on all meshes take turns, so that other work on the machine falls on each alike.
"""

import time
from collections.abc import Sequence
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core.model.assembly import assemble
from sparsemor.core.scene.scene import Scene, load
from sparsemor.core.testing.in_memory_run import march

BLOCK = "plate.thermal"
ATOMS = 12
POD = {"basis": {"use": "pod", "count": ATOMS}}
METHODS: dict[str, dict[str, Any]] = {
    "deim": {"use": "deim", **POD},
    "gnat": {"use": "gnat", "norm": "rows", **POD},
    "ecsw": {"use": "ecsw", "constant": "weighted", "tau": 1e-6, **POD},
    "sparse": {"use": "sparse", **POD, "sampler": {"use": "deim", "required": False},
               "budgets": {"*": {"rows": 2 * ATOMS, "atoms": ATOMS}}},
}
"""Reducer options. Galerkin is not among them: it evaluates the terms on the whole mesh."""
ELEMENTS = 900
"""Number of elements that `gnat` visits on each mesh, in a second row of it."""


def plate(cells: int, steps: int) -> Scene:
    """hot_plate with so many cells over its height and five times as many along it, two triangles
    each; trained on the run itself."""
    return load("hot_plate", {"bodies.plate.mesh.divisions": [5 * cells, cells],
                              "time.end": float(steps), "training": {"end": float(steps)},
                              "check_stability": "off"})


def measure(table: report.Table, meshes: Sequence[int], steps: int, windows: int) -> None:
    """A row for each method on each mesh: ms/step, elements that a step visits, error."""
    kept: list[tuple[dict[str, Any], common.Stepping, list[float]]] = []
    for cells in meshes:
        scene = plate(cells, steps)
        model = assemble(scene)
        truth = march(scene.using({"reducer": "full"}), model=model)
        snapshots = {BLOCK: truth.block(BLOCK).T}
        change = np.abs(truth.x - truth.x[0]).max()
        fewer = {"use": "gnat", "norm": "rows", **POD}
        for name, options in {**METHODS, f"gnat, {ELEMENTS} elements": fewer}.items():
            mine = scene.using({"reducer": options})
            run = march(mine, model=model, snapshots=snapshots)
            way = common.Stepping.begin(mine, model, run.solver)
            d = run.solver.dictionaries[BLOCK]
            off = d.offset + run.block(BLOCK) @ d.atoms.T - truth.block(BLOCK)
            facts = run.solver.facts.get(BLOCK, {})
            rows = sum(len(r) for r in run.solver.rows.values())
            kept.append(({
                "fields": "nonlinear heat", "triangles": 10 * cells**2,
                "unknowns": truth.x.shape[1], "method": name, "rows": rows,
                "elements": facts.get("local_elements_kept",
                                      run.solver.elements_touched[BLOCK]),
                "iterations": float(np.mean(run.iterations)),
                "error": float(np.abs(off).max() / change)}, way, []))
            if name == "gnat":
                visited = kept[-1][0]["elements"]
                fewer["points"] = {BLOCK: min(rows, round(rows * ELEMENTS / visited))}
            report.progress(f"{10 * cells**2} triangles, {name}: {kept[-1][0]}")
    starts = [(way.state, way.memory.copy()) for _, way, _ in kept]
    for _ in range(windows):
        for (_, way, taken), (state, memory) in zip(kept, starts, strict=True):
            way.state, way.memory = state, memory.copy()
            with common.no_collector():
                begun = time.process_time()
                for _ in range(steps):
                    way.step()
                taken.append(1e3 * (time.process_time() - begun) / steps)
    for row, _, taken in kept:
        told = report.quantiles(taken)
        table.add(**row, ms=told["median"], least=told["least"], most=told["most"])
