"""UNTF and Parseval frames against none: paired seeds, a sign test, and two sets of BLAS kernels.

    python tests/benchmarks/untf.py [--quick] [--seeds 30] [--kernels Haswell Prescott]
                                    [--only NAME ..]

Each pair is two runs with the same sampled rows, with a preconditioner of the thermal rows and
without: UNTF with exact eigenvectors of the clipped Gram matrix, as published, UNTF with one
product with that matrix in their place (option `products`), and a Parseval frame. Heat is solved as
published (complete basis, greedy selection from the sampled rows of r); displacements, which it
does not touch and temperatures do not feel, have leading atoms and no selection. A run that stops
counts as worse than one that does not. The test: two-sided, ties left out (scipy.stats.binomtest).
Kernels: each in a process of its own (OPENBLAS_CORETYPE).
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import common
import numpy as np
from modules import report
from modules.recovered_scenes import case_of, combined
from scipy.stats import binomtest

GREEDY = {"use": "greedy_gauss_newton", "candidates": "correlated"}
WITH: dict[str, Any] = {
    "untf": {"use": "untf", "iterations": 20},
    "untf, one product": {"use": "untf", "iterations": 20, "products": 1},
    "parseval": "parseval",
}
"""Preconditioners that are compared with none."""
RATIO = 2.0
"""Ratio of the errors of one seed with two sets of kernels from which on round-off decides."""


def heat(
    atoms: int | None, budgets: Mapping[str, Any], sampler: Mapping[str, Any], elastic: int = 20,
    **options: Any,
) -> dict[str, Any]:
    """Reducer options: heat from a completed basis of so many atoms (None: complete), displacements
    with leading atoms."""
    full = {"use": "pod", "complete": True} | ({} if atoms is None else {"count": atoms})
    return {"use": "sparse", "residual": "plain", "solver": GREEDY, "sampler": dict(sampler),
            "hysteresis": 0.0,
            "basis": {"use": "pod", "count": elastic}, "bases": {"*.thermal": full},
            "budgets": {**budgets, "*.elastic": {"rows": 3 * elastic}}, **options}


DRAWN, RING = {"use": "lhs", "required": False}, {"use": "lhs", "required": "ring"}
PENDULUM = {"*.thermal": {"rows": 43, "atoms": 20}}
SLIDER = {"*.thermal": {"rows": 100, "atoms": 100}}
DISK = {"disk.thermal": {"rows": 200, "atoms": 50}, "pad.thermal": {"rows": 60, "atoms": 20}}
CASES: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "pendulum, 20 of 120": (
        "double_pendulum", {"time.end": 0.05, "training.end": 4.0},
        heat(120, PENDULUM, {"use": "lhs"}, carried=False)),
    "pendulum, 20 of 735": (
        "double_pendulum", {"time.end": 0.05, "training.end": 4.0},
        heat(None, PENDULUM, {"use": "lhs"}, carried=False)),
    "slider, 100 of 600, ring": (
        "slider_plate", {"time.end": 4.5e-4, "training.end": 3.75e-3}, heat(600, SLIDER, RING)),
    "disk, 50 of 400, drawn": (
        "brake_disk", {"time.end": 0.1, "training.end": 0.2}, heat(400, DISK, DRAWN)),
}
"""Name: scene, changes, reducer."""
SMALL = {"bodies.link1.mesh.elements": 320, "bodies.link2.mesh.elements": 320,
         "time.end": 0.02, "training.end": 0.05}


def one(name: str, seeds: Sequence[int], quick: bool = False) -> list[dict[str, Any]]:
    """Pairs of one case: largest thermal and combined error of each run."""
    scene, changes, options = CASES[name]
    case, rows = case_of(scene, changes | (SMALL if quick else {})), []
    for seed in seeds:
        row: dict[str, Any] = {"case": name, "seed": seed}
        for which, P in {"none": "none", **WITH}.items():
            run = case.run({**options, "preconditioner": P}, seed)
            done = isinstance(run, common.Trajectory) and run.failure is None
            row[which] = {"stopped": not done}
            if isinstance(run, common.Trajectory) and done:
                row[which] |= {
                    "thermal": max(float(case.series(n, run).max()) for n in case.model.reducible()
                                   if n.endswith(".thermal")),
                    "combined": combined(case, run)}
        rows.append(row)
        report.progress(f"{row}")
    return rows


def size(run: Mapping[str, Any], measure: str) -> float:
    return float("inf") if run["stopped"] else float(run[measure])


def judged(rows: Sequence[Mapping[str, Any]], measure: str, which: str) -> dict[str, Any]:
    """Medians, and the sign test of `measure`, for the preconditioner `which`."""
    pairs = [(size(r["none"], measure), size(r[which], measure)) for r in rows]
    better, worse = sum(b < a for a, b in pairs), sum(b > a for a, b in pairs)
    p = float(binomtest(better, better + worse).pvalue) if better + worse else 1.0
    none, preconditioned = (float(np.median([p[i] for p in pairs])) for i in (0, 1))
    return {"none": none, "with": preconditioned, "better_with": better, "worse_with": worse,
            "p": p, "verdict": "no difference shown" if p >= 0.05 else
            "better" if better > worse else "worse"}


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "pairs": f"seeds 1 to {given.seeds}, the same rows with a preconditioner and without",
        "errors": "medians of the largest errors of the runs; inf: more than half stopped",
        "p": "two-sided sign test; below 0.05 counts as a difference"}
    found: dict[str, list[dict[str, Any]]] = {}
    for kernels in given.kernels:
        short = ["--quick"] if given.quick else []
        done = subprocess.run(
            [sys.executable, __file__, "--child", "--seeds", str(given.seeds), "--only",
             *given.only, *short], env={**os.environ, "OPENBLAS_CORETYPE": kernels}, check=True,
            stdout=subprocess.PIPE, text=True)
        found[kernels] = json.loads(done.stdout)
    compared(out, found, given.only)


def compared(
    out: report.Report, found: Mapping[str, list[dict[str, Any]]], names: Sequence[str]
) -> None:
    """Tables of the pairs of each set of kernels."""
    for measure in ("thermal", "combined"):
        table = out.table(f"{measure} error", none=".1e", p=".2g", **{"with": ".1e"})
        for name, which in product(names, WITH):
            for kernels, rows in found.items():
                own = [r for r in rows if r["case"] == name]
                stops = {f"stopped_{label}": sum(r[w]["stopped"] for r in own)
                         for label, w in (("none", "none"), ("with", which))}
                table.add(case=name, preconditioner=which, kernels=kernels,
                          **judged(own, measure, which), **stops)
    if len(found) > 1:
        between(out, *list(found.values())[:2], names)


def between(
    out: report.Report, one: Sequence[Mapping[str, Any]], other: Sequence[Mapping[str, Any]],
    names: Sequence[str],
) -> None:
    """Seeds whose thermal error differs between two sets of kernels by more than `RATIO`."""
    table = out.table(f"seeds whose thermal error differs by more than {RATIO:g} times, or whose "
                      "end differs, between the kernels")
    for name in names:
        row: dict[str, Any] = {"case": name}
        for which in ("none", *WITH):
            pairs = [(size(a[which], "thermal"), size(b[which], "thermal"))
                     for a, b in zip(one, other, strict=True) if a["case"] == name]
            row[which] = sum(a != b and not max(a, b) <= RATIO * min(a, b) for a, b in pairs)
            row["seeds"] = len(pairs)
        table.add(**row)


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    parser = report.options("untf", __doc__)
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--kernels", nargs="+", default=["Haswell", "Prescott"])
    parser.add_argument("--only", nargs="+", choices=[*CASES], default=[*CASES], metavar="NAME")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    found = parser.parse_args(given)
    if found.quick:
        found.seeds, found.only, found.kernels = 2, ["pendulum, 20 of 120"], found.kernels[:1]
    return found


if __name__ == "__main__":
    told = arguments()
    if told.child:
        rows = [r for name in told.only for r in one(
            name, range(1, told.seeds + 1), told.quick)]
        sys.stdout.write(json.dumps(rows))
        sys.exit(0)
    sys.exit(report.run_plan("untf", fill, told))
