"""Steps from 1e-2 to 1e-6 s: bordered full order against Newton's method, and reduced models.

    python tests/benchmarks/step_sizes.py [--quick] [--out step_sizes.json]

A flexible pendulum under gravity, in the plane and in space, stiff and soft, with four integrators.
Both full-order methods and two reduced ones, trained on the full-order run, take the same steps
from the same start. "of motion" is the largest difference of rigid coordinates and of displacements
relative to the largest rigid coordinate; "of bending" that of displacements relative to the largest
displacement.
"""

import argparse
import sys
from typing import Any

import common  # noqa: F401  # before NumPy: it limits linear algebra to one thread
import numpy as np
from modules import report

from sparsemor.core.status import SolveFailed
from sparsemor.core.testing.in_memory_run import March, march, scene_of

INTEGRATORS: dict[str, Any] = {
    "bdf1": "bdf1", "bdf2": "bdf2",
    "alpha 0.5": {"use": "generalized_alpha", "rho_inf": 0.5},
    "alpha 0.8": {"use": "generalized_alpha", "rho_inf": 0.8}}
STEPS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
COUNT = 30
"""Steps of each run."""
LIMIT = 1e-9
"""Largest difference of the motion of bordered and Newton's steps."""
POD = {"use": "pod", "count": 12}
REDUCED: dict[str, Any] = {
    "galerkin": {"use": "galerkin", "basis": POD},
    "sparse": {"use": "sparse", "residual": "plain", "basis": POD,
               "budgets": {"*": {"rows": 80}}}}


def rod(space: bool, E: float) -> dict[str, Any]:
    size, divisions = ([1.0, 0.1, 0.1], [10, 2, 2]) if space else ([1.0, 0.1], [40, 4])
    body: dict[str, Any] = {
        "use": "flexible", "fields": ["elastic"], "reference": {"clamp": "left"},
        "mesh": {"use": "block" if space else "rectangle", "size": size, "divisions": divisions},
        "material": {"E": E, "rho": 1000, "nu": 0.3}, "damping": {"stiffness": 5e-4}}
    return body if space else {**body, "thickness": 0.1}


def scene(space: bool, E: float, integrator: str, h: float, reducer: Any) -> Any:
    down = [0.0, -9.81, 0.0] if space else [0.0, -9.81]
    pin = {"use": "spherical" if space else "revolute", "between": ["ground", "rod:left"]}
    return scene_of({
        "bodies": {"rod": rod(space, E)}, "joints": {"pin": pin},
        "loads": {"weight": {"use": "gravity", "g": down}}, "reducer": reducer,
        "time": {"end": COUNT * h, "step": h}, "integrator": INTEGRATORS[integrator]})


def run(made: Any, **training: Any) -> March | str:
    """The run, or the status that it ended with."""
    try:
        return march(made, **training)
    except SolveFailed as failed:
        return failed.status.value


def bent(of: March) -> Any:
    """Displacements (M, n) in full unknowns."""
    x, maps = of.block("rod.elastic"), of.solver.dictionaries
    if "rod.elastic" not in maps:
        return x
    d = maps["rod.elastic"]
    return d.offset + x @ d.atoms.T


def difference(one: March, other: March) -> tuple[float, float]:
    """Of motion, of bending."""
    rigid = np.abs(one.block("rod.rigid") - other.block("rod.rigid")).max()
    u, w = bent(one), bent(other)
    size = max(float(np.abs(other.block("rod.rigid")).max()), 1.0)
    off = float(np.abs(u - w).max())
    return max(float(rigid), off) / size, off / max(float(np.abs(w).max()), 1e-300)


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "steps": COUNT, "predictor, tolerance": "defaults", "reduced": "12 POD atoms, 80 rows"}
    table = out.table("Bordered against Newton, and reduced against full order",
                      iterations=".2f", of_Newton=".2f")
    worst, failed = 0.0, 0
    for space in (False,) if given.quick else (False, True):
        for E in (7e7, 7e10):
            for name in INTEGRATORS:
                report.progress(f"{'space' if space else 'plane'}, {E:g} Pa, {name}")
                for h in given.sizes:
                    row: dict[str, Any] = {
                        "scene": "space" if space else "plane", "E": E, "integrator": name,
                        "step": h}
                    full = run(scene(space, E, name, h, "full"))
                    newton = run(scene(space, E, name, h, {"use": "full", "method": "newton"}))
                    statuses = [full, newton]
                    if isinstance(full, March):
                        row["iterations"] = float(np.mean(full.iterations))
                        snapshots = {"rod.elastic": full.block("rod.elastic").T}
                        if isinstance(newton, March):
                            row["of_Newton"] = float(np.mean(newton.iterations))
                            row["of_motion"], row["of_bending"] = difference(full, newton)
                            worst = max(worst, row["of_motion"])
                        for reducer, options in REDUCED.items():
                            made = run(scene(space, E, name, h, options), model=full.model,
                                       snapshots=snapshots)
                            statuses.append(made)
                            if isinstance(made, March):
                                row[f"{reducer}, bending"] = difference(made, full)[1]
                    bad = [s for s in statuses if isinstance(s, str)]
                    failed += len(bad)
                    row["ended"] = ", ".join(bad) or "done"
                    table.add(**row)
    out.at_most("difference of motion, bordered and Newton", worst, LIMIT)
    out.at_most("runs that did not end done", float(failed), 0.0)


def arguments() -> argparse.Namespace:
    parser = report.options("step_sizes", __doc__)
    given = parser.parse_args()
    given.sizes = STEPS[1:2] if given.quick else STEPS
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("step_sizes", fill, arguments()))
