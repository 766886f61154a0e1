"""Cost of a step: full order, full order the textbook way, Galerkin and sparse, on three meshes.

    python tests/benchmarks/cost.py [--quick] [--out cost.json]

Every method goes through the same steps of the double pendulum, in windows that take turns, so
that a busy moment of the machine hits all of them. A window's figure is the median over its
steps; the table shows the median, least and most of the windows.
"""

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.reducers.step.compiled.compiled_stepper import installed

MESHES = (1280, 5120, 20480)
WARM = 100
"""Steps before the first window: no figure contains the start."""
TRAINED = 4.0
"""Training run, s, of all but the finest mesh: a shorter one has fewer than 30/20 modes."""


@dataclass
class Contender:
    """One method on one mesh. steps: of one window; ms, iterations: one entry a window."""

    method: str
    elements: int
    way: common.Stepping
    steps: int
    atoms: str
    ms: list[float] = field(default_factory=list)
    iterations: list[float] = field(default_factory=list)

    def window(self) -> None:
        ms, iterations = self.way.advance(self.steps)
        self.ms.append(ms)
        self.iterations.append(iterations)


def methods(rows: tuple[int, int]) -> dict[str, Mapping[str, Any]]:
    """Reducer options of the methods whose windows have the same steps."""
    return {
        "full": {"use": "full"},
        "galerkin": common.galerkin(30, 20),
        "sparse": common.sparse(rows, (30, 20)),
        "sparse, 15/10 of all": common.sparse(rows, (None, None), active=(15, 10), every=100),
    }


def compiled(rows: tuple[int, int]) -> dict[str, Mapping[str, Any]]:
    """The reduced ones with compiled steps."""
    return {f"{name}, compiled": {**options, "compiled": "on"}
            for name, options in methods(rows).items() if name != "full"}


def contenders(elements: int, given: argparse.Namespace) -> list[Contender]:
    """All methods on one mesh, warmed up; only the solvers outlive this, not the snapshots."""
    warm = 10 if given.quick else WARM
    end = (warm + given.repeats * given.steps) * 1e-3
    if elements < MESHES[-1] and not given.quick:
        end = max(end, TRAINED)
    case = common.Case.of(common.scene_at(elements, end), steps=1)
    made = []
    ways = methods(given.rows) | ({} if given.quick or not installed() else compiled(given.rows))
    for name, options in ways.items():
        way = common.Stepping.begin(case.scene, case.model, case.prepared(options))
        way.advance(warm)
        atoms = "/".join(str(d.atoms.shape[1]) for d in list(
            way.solver.dictionaries.values())[:: len(case.model.parts) // 2 or 1][:2])
        made.append(Contender(name, elements, way, given.steps, atoms or "-"))
    if elements <= given.newton_up_to:
        made.append(_textbook(case, made[0], given))
    return made


def _textbook(case: common.Case, full: Contender, given: argparse.Namespace) -> Contender:
    """Goes on from full order's state; its own predictor fills up before the first window."""
    solver = case.prepared({"use": "full", "method": "newton"})
    _, memory = solver.start(full.way.state)
    way = common.Stepping(case.scene, solver, full.way.state, memory)
    way.advance(7)
    return Contender("full, newton", full.elements, way, given.newton_steps, "-")


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": "double_pendulum, bdf1, h = 1 ms", "triangles a link": given.elements,
        "training": f"{TRAINED:g} s; on the finest mesh only the steps that are timed",
        "windows": f"{given.repeats} in turn, {given.steps} steps each "
                   f"({given.newton_steps} for newton)",
        "rows sampled": f"{given.rows[0]}/{given.rows[1]} elastic/thermal, on top of the required",
        "sparse, 15/10 of all": "15/10 active of the whole POD, chosen again every 100 steps",
        "full, newton": "whole Jacobian factorized in each iteration, default SuperLU ordering",
        "garbage collector": "off in the windows", "seed": 1}
    table = out.table("Milliseconds a step", iterations=".2f")
    ratios = out.table("Ratios of the medians (and of single windows)")
    entered: list[Contender] = []
    for elements in given.elements:
        report.progress(f"prepare {elements}")
        entered += contenders(elements, given)
    try:
        for repeat in range(given.repeats):
            report.progress(f"window {repeat + 1} of {given.repeats}")
            for c in entered:
                c.window()
    finally:
        _tabulate(out, table, ratios, [c for c in entered if c.ms])


def _tabulate(
    out: report.Report, table: report.Table, ratios: report.Table, timed: list[Contender]
) -> None:
    found = {(c.method, c.elements): c for c in timed}
    for c in timed:
        q = report.quantiles(c.ms)
        table.add(triangles=c.elements, method=c.method, ms=q["median"], least=q["least"],
                  most=q["most"], iterations=float(np.mean(c.iterations)), atoms=c.atoms)
    pairs = [("full, newton", "full"), ("full", "galerkin"), ("full", "sparse"),
             ("sparse", "galerkin"), ("galerkin", "galerkin, compiled"),
             ("sparse", "sparse, compiled"), ("full", "galerkin, compiled")]
    wanted = {("full, newton", "full", 1280): (">=", 60.0), ("sparse", "galerkin", 1280):
              ("<=", 1.3), ("sparse", "galerkin", 5120): ("<=", 1.3),
              ("sparse", "galerkin", 20480): ("<=", 1.3),
              ("galerkin", "galerkin, compiled", 1280): (">=", 5.0),
              ("full", "galerkin, compiled", 20480): (">=", 700.0)}
    for method in ("galerkin", "sparse"):
        wanted |= {("full", method, 1280): (">=", 5.0), ("full", method, 20480): (">=", 120.0)}
    for slow, fast in pairs:
        for elements in dict.fromkeys(c.elements for c in timed):
            a, b = found.get((slow, elements)), found.get((fast, elements))
            if a is None or b is None:
                continue
            ratio = report.quantiles(a.ms)["median"] / report.quantiles(b.ms)["median"]
            single = report.quantiles([x / y for x, y in zip(a.ms, b.ms, strict=False)])
            ratios.add(triangles=elements, ratio=f"{slow} : {fast}", value=ratio,
                       least=single["least"], most=single["most"])
            if (slow, fast, elements) in wanted:
                sign, limit = wanted[slow, fast, elements]
                check = out.at_least if sign == ">=" else out.at_most
                check(f"{slow} : {fast} at {elements}", ratio, limit)
    for method in ("galerkin, compiled", "sparse, compiled"):
        if (method, 1280) in found:
            out.at_most(f"{method}, ms at 1280",
                        report.quantiles(found[method, 1280].ms)["median"], 0.020)
    for method in ("galerkin", "sparse", "galerkin, compiled"):
        medians = [report.quantiles(c.ms)["median"] for c in timed if c.method == method]
        if len(medians) > 1:
            out.at_most(f"spread of {method} over the meshes, most/least - 1",
                        max(medians) / min(medians) - 1, 0.15)


def arguments() -> argparse.Namespace:
    parser = report.options("cost", __doc__)
    parser.add_argument("--elements", type=int, nargs="+", default=list(MESHES))
    parser.add_argument("--repeats", type=int, default=7, help="windows of each method")
    parser.add_argument("--steps", type=int, default=200, help="steps of a window")
    parser.add_argument("--newton-steps", type=int, default=3)
    parser.add_argument("--newton-up-to", type=int, default=20480, metavar="TRIANGLES")
    parser.add_argument("--rows", type=int, nargs=2, default=(240, 80))
    given = parser.parse_args()
    if given.quick:
        given.elements, given.repeats, given.steps, given.newton_steps = [1280], 2, 20, 1
    given.rows = (given.rows[0], given.rows[1])
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("cost", fill, arguments()))
