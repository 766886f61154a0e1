"""DEIM, GNAT and LSPG beside Galerkin and full order: errors of each field and time of a step.

    python tests/benchmarks/hyper_reduction.py [--quick] [--out hyper_reduction.json]

One training run serves all. Times come from windows of steps that take turns; compare rows of one
table only.
"""

import argparse
import sys
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core.registry.registry import Registry
from sparsemor.core.status import SolveFailed

METHODS: dict[str, dict[str, Any]] = {
    "galerkin": {"use": "galerkin"}, "lspg": {"use": "lspg", "norm": "rows"},
    "deim": {"use": "deim"},
    "gnat": {"use": "gnat", "norm": "rows"}, "gnat, energy": {"use": "gnat"},
    "ecsw": {"use": "ecsw", "constant": "weighted"}}
MATCH, REACH = 1e-8, 1e-4
"""Wanted in each field: deim is to match galerkin, whose own error is far below; gnat and ecsw are
to reach full order so far."""
WARM = 100


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": f"double_pendulum, 2 x {given.elements} triangles, bdf1, h = 1 ms, "
                 f"{given.end:g} s",
        "atoms": "elastic/thermal POD; the default options of each method otherwise",
        "modes, points, amplification": "of link1, elastic/thermal; amplification: the most that "
                                        "what the modes leave of a force can grow",
        "errors": "largest over time: angle in rad; elastic (late half, or from 0.1 s on) and "
                  "thermal relative to the block's largest change, worse link"}
    case = common.Case.of(common.scene_at(given.elements, given.end))
    installed = {name.name for name in Registry().names("reducer")}
    methods = {n: o for n, o in METHODS.items() if o["use"] in installed}
    compared(out, case, methods, given)
    few_atoms(out, case, methods, given)
    few_modes(out, case, given)
    drawn_points(out, case, given)


def atoms(elastic: int, thermal: int) -> dict[str, Any]:
    return {"basis": {"use": "pod", "count": elastic},
            "bases": {"*.thermal": {"use": "pod", "count": thermal}}}


def compared(
    out: report.Report, case: common.Case, methods: dict[str, dict[str, Any]],
    given: argparse.Namespace,
) -> None:
    """Default options, 30/20 atoms, with the targets."""
    table, ways = out.table("Errors and time of a step"), {}
    for name, options in {"full": {"use": "full"}, **methods}.items():
        wanted = options if name == "full" else {**options, **atoms(30, 20)}
        ways[name] = common.Stepping.begin(case.scene, case.model, case.prepared(wanted))
        ways[name].advance(10 if given.quick else WARM)
    ms: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(given.repeats):
        for name, way in ways.items():
            ms[name].append(way.advance(given.steps)[0])
    middle = {name: float(np.median(taken)) for name, taken in ms.items()}
    table.add(method="full", ms=middle["full"], full_to_this=1.0)
    for name, options in methods.items():
        row = judged(case, {**options, **atoms(30, 20)})
        table.add(method=name, **row, ms=middle[name], full_to_this=middle["full"] / middle[name])
        report.progress(f"{name}: {row}")
        limit = {"deim": MATCH, "gnat": REACH, "ecsw": REACH}.get(name)
        for field in ("angle", "elastic", "thermal"):
            if limit is not None:
                error = row.get(field)
                out.at_most(f"{name}, {field}", 1e300 if error is None else error, limit)


def few_atoms(
    out: report.Report, case: common.Case, methods: dict[str, dict[str, Any]],
    given: argparse.Namespace,
) -> None:
    """What is left of the residual, and in which norm it is least, shows with few atoms."""
    table = out.table("Fewer atoms")
    for counts in given.few:
        for name, options in methods.items():
            row = judged(case, {**options, **atoms(*counts)})
            table.add(atoms=f"{counts[0]}/{counts[1]}", method=name, **row)


def few_modes(out: report.Report, case: common.Case, given: argparse.Namespace) -> None:
    """Force modes by the energy that they leave out; the published criterion leaves out 1e-4."""
    table = out.table("Force modes", left_out=".0e")
    for left in given.left_out:
        for name in ("deim", "gnat"):
            for times in (1.0, 2.0):
                options = {"use": name, "force_basis": {"use": "pod", "energy": 1.0 - left},
                           "oversampling": times, **atoms(30, 20)}
                table.add(left_out=left, method=name, points_a_mode=times, **judged(case, options))


def drawn_points(out: report.Report, case: common.Case, given: argparse.Namespace) -> None:
    """Points that do not look at the modes: how often they fail."""
    table = out.table("Drawn points")
    for name in ("deim", "gnat"):
        for times in (1.0, 2.0, 4.0):
            for required in (False, True):
                options = {"use": name, "sampler": "lhs", "oversampling": times,
                           "required": required, **atoms(30, 20)}
                rows = [judged(case, options, seed) for seed in range(1, given.seeds + 1)]
                good = [r for r in rows if r["status"] == "done" and max(
                    r[f] for f in ("angle", "elastic", "thermal")) <= 1e-2]
                stopped = [r["status"] for r in rows if r["status"] != "done"]
                table.add(
                    method=name, points_a_mode=times, required="kept" if required else "no",
                    seeds=given.seeds, stopped=len(stopped),
                    inaccurate=len(rows) - len(good) - len(stopped),
                    worst_elastic=max((r["elastic"] for r in good), default=None),
                    first_stop=stopped[0] if stopped else "")
        report.progress(f"drawn points of {name}")


def judged(case: common.Case, options: dict[str, Any], seed: int = 1) -> dict[str, Any]:
    """One run: what it used, how far it is off, how it ended."""
    run = case.run(options, seed)
    if isinstance(run, SolveFailed):
        return {"status": common.in_words(run)}
    facts = [run.solver.facts.get(f"link1.{field}", {}) for field in ("elastic", "thermal")]
    row: dict[str, Any] = {}
    for key in ("force_modes", "points"):
        row[key] = "/".join(str(f[key]) for f in facts if key in f) or None
    row["amplification"] = "/".join(
        f"{f['amplification']:.2g}" for f in facts if "amplification" in f) or None
    if run.failure is None:
        row |= case.errors(run)
    return row | {"status": "done" if run.failure is None else common.in_words(run.failure)}


def arguments() -> argparse.Namespace:
    parser = report.options("hyper_reduction", __doc__)
    parser.add_argument("--elements", type=int, default=1280, help="triangles a link")
    parser.add_argument("--end", type=float, default=4.0, help="s")
    parser.add_argument("--repeats", type=int, default=5, help="windows of each method")
    parser.add_argument("--steps", type=int, default=200, help="steps of a window")
    parser.add_argument("--seeds", type=int, default=10)
    given = parser.parse_args()
    given.few, given.left_out = [(20, 20), (10, 10)], [1e-4, 1e-8, 1e-12]
    if given.quick:
        given.elements, given.end, given.repeats, given.steps, given.seeds = 320, 0.1, 2, 10, 2
        given.few, given.left_out = [(6, 4)], [1e-4]
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("hyper_reduction", fill, arguments()))
