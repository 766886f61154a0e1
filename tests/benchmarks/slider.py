"""Slider on plate: every method over its four fields, in training and outside of it.

    python tests/benchmarks/slider.py [--quick] [--seeds 10] [--only NAME ..] [--cases NAME ..]
        [--out slider.json]

In training: the run that is repeated. Outside: a model that learned at 1 m/s and mu = 0.2 is run
at 0.8 m/s, at mu = 0.15 and at both, one that learned on the first half of the travel on all of it.
The rigid stage of each case is its own; only what is learned (snapshots) comes from elsewhere.
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import common  # noqa: F401  # before NumPy: it limits linear algebra to one thread
from modules import report
from modules.method_runs import (
    MEANINGS,
    STOPPED,
    elsewhere_columns,
    file_name,
    full_of,
    one,
    options,
    over_seeds,
    over_whole_run,
    seeds_told,
    worst,
)

from sparsemor.core.scene.scene import Scene, load
from sparsemor.plugins.comparison.cost import run_facts

BLOCKS = ("slider.elastic", "plate.elastic", "slider.thermal", "plate.thermal")
POD = {"basis": {"use": "pod", "count": 100}, "bases": {
    "plate.elastic": {"use": "pod", "count": 80},
    "slider.*": {"use": "pod", "count": 20}}}
WEIGHTED = {"basis": {"use": "pod", "count": 100, "weights": "inverse_sqrt_norm"}, "bases": {
    "plate.elastic": {"use": "pod", "count": 80, "weights": "inverse_sqrt_norm"},
    "slider.*": {"use": "pod", "count": 20, "weights": "inverse_sqrt_norm"}}}
PULSES, FEWER = {"use": "impulse", "count": 300}, {"use": "impulse", "count": 120}


def training_free(
    plate: Mapping[str, Any] = PULSES, slider: Mapping[str, Any] = FEWER
) -> dict[str, Any]:
    """Temperatures by a basis each, displacements by attachment modes of loads and temperatures."""
    def displacements(heat: Mapping[str, Any], count: int) -> dict[str, Any]:
        return {"use": "dictionary", "orthonormal": True, "bases": [
            {"use": "attachment", "thermal": heat, "count": count}, "static"]}

    return {"basis": plate, "bases": {
        "slider.thermal": slider, "plate.elastic": displacements(plate, 300),
        "slider.elastic": displacements(slider, 120)}}


def beside(count: int, pulses: Mapping[str, Any]) -> dict[str, Any]:
    """POD of the training run beside pulses."""
    return {"use": "dictionary", "orthonormal": True, "bases": [
        {"use": "pod", "count": count, "weights": "inverse_sqrt_norm"}, pulses]}


FREE = training_free()
BOTH = training_free(beside(80, PULSES), beside(20, FEWER))
ROWS = {"plate.elastic": {"rows": 200}, "plate.thermal": {"rows": 400},
        "slider.elastic": {"rows": 200}, "slider.thermal": {"rows": 400}}
MANY = {"plate.elastic": {"rows": 500}, "plate.thermal": {"rows": 450},
        "slider.elastic": {"rows": 250}, "slider.thermal": {"rows": 200}}
FEW = {"plate.elastic": {"rows": 110}, "plate.thermal": {"rows": 140},
       "slider.elastic": {"rows": 30}, "slider.thermal": {"rows": 30}}


def sparse(basis: Mapping[str, Any], **options: Any) -> dict[str, Any]:
    return {"use": "sparse", "residual": "plain", **basis, "budgets": ROWS, **options}


def published(**options: Any) -> dict[str, Any]:
    """The published reducer with one draw of rows and centred snapshots, which makes a step cheap
    enough to count seeds."""
    own: dict[str, Any] = load("slider_plate_published").dump()["reducer"]
    centred = {"use": "pod", "centred": True, "complete": True}
    return {**own, "resample": None, "basis": centred, **options}


Q_DEIM = {"use": "deim", "method": "qr", "required": "ring"}


def methods() -> dict[str, tuple[dict[str, Any], bool]]:
    """Reducer by name, and whether its rows depend on the seed."""
    drawn = {"use": "lhs", "required": False}
    return {
        "galerkin": ({"use": "galerkin", **POD}, False),
        "deim": ({"use": "deim", **POD}, False),
        "gnat": ({"use": "gnat", "norm": "rows", **POD}, False),
        "ecsw": ({"use": "ecsw", "constant": "weighted", **POD}, False),
        "published, UNTF": (published(), True),
        "published, none": (published(preconditioner="none"), True),
        "leading atoms, LHS, UNTF": (sparse(POD, sampler=drawn, preconditioner="untf"), True),
        "leading atoms, LHS, none": (sparse(POD, sampler=drawn), True),
        "LHS + ring": (sparse(POD, sampler={"use": "lhs", "required": "ring"}), True),
        "Q-DEIM + ring": (sparse(POD, sampler=Q_DEIM, budgets=FEW), False),
        "recommended": (recommended(), True),
        "training-free, galerkin": ({"use": "galerkin", **FREE}, False),
        "POD and training-free, galerkin": ({"use": "galerkin", **BOTH}, False),
    }


def recommended() -> dict[str, Any]:
    """As packaged."""
    own: dict[str, Any] = load("slider_plate").dump()["reducer"]
    return own


CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "0.8 m/s": ({"joints.drive.x.final": 0.8, "bodies.slider.pose.velocity": [0.8, 0.0]},
                {"training.overrides": {"joints.drive.x.final": 1.0,
                                        "bodies.slider.pose.velocity": [1.0, 0.0]}}),
    "mu 0.15": ({"contacts.sole.friction.coefficient": 0.15},
                {"training.overrides": {"contacts.sole.friction.coefficient": 0.2}}),
    "0.8 m/s and mu 0.15": (
        {"joints.drive.x.final": 0.8, "bodies.slider.pose.velocity": [0.8, 0.0],
         "contacts.sole.friction.coefficient": 0.15},
        {"training.overrides": {"joints.drive.x.final": 1.0,
                                "bodies.slider.pose.velocity": [1.0, 0.0],
                                "contacts.sole.friction.coefficient": 0.2}}),
    "half of the travel": ({}, {"training.end": 1.875e-3}),
}


def outside() -> dict[str, dict[str, Any]]:
    return {
        "galerkin, POD": {"use": "galerkin", **POD},
        "galerkin, POD weighted": {"use": "galerkin", **WEIGHTED},
        "galerkin, training-free": {"use": "galerkin", **FREE},
        "galerkin, POD and training-free": {"use": "galerkin", **BOTH},
        "deim, POD": {"use": "deim", **POD},
        "ecsw, POD": {"use": "ecsw", "constant": "weighted", **POD},
        "sparse, training-free, rows of D^-1 r": sparse(
            FREE, sampler=Q_DEIM, residual="preconditioned", budgets=MANY),
        "recommended": recommended(),
    }


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": "slider_plate: 1336 and 2034 triangles, 1000 steps of 3.75e-6 s, bdf1",
        "growth": "(spectral radius - 1) x steps of the worst of the states that are looked at",
        "seeds": seeds_told(given.seeds), **MEANINGS}
    base = load("slider_plate", given.small)
    folder = Path(tempfile.mkdtemp(prefix="slider-"))
    if not given.outside:
        inside(out, given, base, folder)
    if not given.inside:
        elsewhere(out, given, base, folder)


def inside(out: report.Report, given: argparse.Namespace, base: Scene, folder: Path) -> None:
    table = out.table("In training")
    truth = full_of(base, folder / "full")
    table.add(method="full", ms=run_facts(truth).ms_per_step)
    for name, (reducer, drawn) in methods().items():
        if given.only and name not in given.only:
            continue
        rows = over_seeds(base, truth, folder, BLOCKS, name, reducer, given.seeds if drawn else 1)
        table.add(method=name, **worst(rows))
        if name == "recommended":
            targets(out, rows)


def targets(out: report.Report, rows: Sequence[Mapping[str, Any]]) -> None:
    out.at_most("recommended: runs that stopped", sum(r["stopped"] for r in rows), 0)
    for when, limit in (("start-up", 1e-2), ("steady", 1e-4)):
        values = [r[f"{b} {when}"] for r in rows for b in BLOCKS]
        out.at_most(f"recommended: worst field, {when}",
                    max(STOPPED if v is None else v for v in values), limit)
    for when, limit in (("start-up", 0.4), ("steady", 7e-4)):
        errors = [r[f"combined {when}"] for r in rows]
        out.at_most(f"recommended: combined, {when} (the paper's own)",
                    max(STOPPED if e is None else e for e in errors), limit)


def elsewhere(out: report.Report, given: argparse.Namespace, base: Scene, folder: Path) -> None:
    table = out.table("Outside training: worst error of each field, whole run")
    best: dict[str, float] = {}
    for case, (changes, training) in CASES.items():
        if given.cases and case not in given.cases:
            continue
        scene = base.using(changes)
        truth = full_of(scene, folder / file_name(f"full-{case}"))
        for name, reducer in outside().items():
            if given.only and name not in given.only:
                continue
            reduced = scene.using({"reducer": reducer, **training})
            row = one(reduced, truth, folder / file_name(f"{case}-{name}"), BLOCKS)
            errors = [over_whole_run(row, b) for b in BLOCKS]
            top = max(STOPPED if e is None else e for e in errors)
            best[name] = max(best.get(name, 0.0), top)
            table.add(case=case, method=name, **elsewhere_columns(row, BLOCKS))
            report.progress(f"{case}: {table.rows[-1]}")
    if best:
        out.at_most("least worst error of a method over all cases", min(best.values()), 1e-3)


def arguments() -> argparse.Namespace:
    parser = options("slider", __doc__, seeds=10)
    parser.add_argument("--cases", nargs="+", choices=CASES, metavar="NAME",
                        help="these cases outside training alone")
    given = parser.parse_args()
    given.small = {}
    if given.quick:
        given.seeds = 1
        given.small = {"time.end": 1.5e-4, "training.end": 1.5e-4}
        given.only = given.only or ["galerkin", "galerkin, POD"]
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("slider", fill, arguments()))
