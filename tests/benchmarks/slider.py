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

import numpy as np
import report

from sparsemor.core.compare import measure_errors
from sparsemor.core.error_measures import Errors
from sparsemor.core.errors import InputError
from sparsemor.core.results import RunResult
from sparsemor.core.run_facts import run_facts
from sparsemor.core.scene import Scene, load
from sparsemor.core.simulate import simulate
from sparsemor.core.status import SolveFailed

STOPPED = 1e300
"""Stands for the error of a run that stopped before there was one."""
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
    return {"use": "sparse", **basis, "budgets": ROWS, **options}


def published(**options: Any) -> dict[str, Any]:
    own: dict[str, Any] = load("slider_plate_published").dump()["reducer"]
    return {**own, **options}


Q_DEIM = {"use": "deim", "method": "qr", "required": "ring"}


def methods() -> dict[str, tuple[dict[str, Any], bool]]:
    """Reducer by name, and whether its rows depend on the seed."""
    drawn = {"use": "lhs", "required": False}
    return {
        "galerkin": ({"use": "galerkin", **POD}, False),
        "deim": ({"use": "deim", **POD}, False),
        "gnat": ({"use": "gnat", **POD}, False),
        "ecsw": ({"use": "ecsw", **POD}, False),
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
        "ecsw, POD": {"use": "ecsw", **POD},
        "sparse, training-free, rows of D^-1 r": sparse(
            FREE, sampler=Q_DEIM, residual="preconditioned", budgets=MANY),
        "recommended": recommended(),
    }


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": "slider_plate: 1336 and 2034 triangles, 1000 steps of 3.75e-6 s, bdf1",
        "start-up": "largest error in the first 2 % of the steps; steady: in the rest",
        "errors": "of a field: relative to its largest change; joint: of all unknowns, "
                  "relative to their norm at the same time, as the paper defines it",
        "growth": "(spectral radius - 1) x steps of the worst of the states that are looked at",
        "seeds": f"1 to {given.seeds} where rows are drawn; worst seed, and how many stopped",
        "ms": "median of a step, and how often full order takes that"}
    base = load("slider_plate", given.small)
    folder = Path(tempfile.mkdtemp(prefix="slider-"))
    if not given.outside:
        inside(out, given, base, folder)
    if not given.inside:
        elsewhere(out, given, base, folder)


def inside(out: report.Report, given: argparse.Namespace, base: Scene, folder: Path) -> None:
    table = out.table("In training")
    truth = run(base.using({"reducer": "full"}), folder / "full")
    assert isinstance(truth, RunResult)
    table.add(method="full", ms=run_facts(truth).ms_per_step)
    for name, (options, drawn) in methods().items():
        if given.only and name not in given.only:
            continue
        rows = []
        for seed in range(1, (given.seeds if drawn else 1) + 1):
            scene = base.using({"reducer": options, "seed": seed})
            rows.append(one(scene, truth, folder / _file(f"{name}-{seed}")))
            report.progress(f"{name}, seed {seed}: {rows[-1]}")
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
        out.at_most(f"recommended: joint, {when} (the paper's own)",
                    max(STOPPED if (v := r[f"joint {when}"]) is None else v for r in rows), limit)


def elsewhere(out: report.Report, given: argparse.Namespace, base: Scene, folder: Path) -> None:
    table, best = out.table("Outside training: worst error of each field, whole run"), {}
    for case, (changes, training) in CASES.items():
        if given.cases and case not in given.cases:
            continue
        scene = base.using(changes)
        truth = run(scene.using({"reducer": "full"}), folder / _file(f"full-{case}"))
        assert isinstance(truth, RunResult)
        for name, options in outside().items():
            if given.only and name not in given.only:
                continue
            reduced = scene.using({"reducer": options, **training})
            row = one(reduced, truth, folder / _file(f"{case}-{name}"))
            errors = {b: _max(row[f"{b} start-up"], row[f"{b} steady"]) for b in BLOCKS}
            top = max(STOPPED if e is None else e for e in errors.values())
            best[name] = max(best.get(name, 0.0), top)
            table.add(case=case, method=name, **errors, joint=_max(
                row["joint start-up"], row["joint steady"]), ms=row["ms"], speed_up=row["speed_up"],
                offline_s=row["offline_s"], atoms=row["atoms"], status=row["status"])
            report.progress(f"{case}: {table.rows[-1]}")
    if best:
        out.at_most("least worst error of a method over all cases", min(best.values()), 1e-3)


def _file(text: str) -> str:
    return text.replace(" ", "_").replace("/", "")


def _max(a: float | None, b: float | None) -> float | None:
    known = [v for v in (a, b) if v is not None]
    return max(known) if known else None


def run(scene: Scene, path: Path) -> RunResult | SolveFailed | InputError:
    try:
        return simulate(scene, out=path)
    except (SolveFailed, InputError) as failure:
        return failure


def one(
    scene: Scene, truth: RunResult, path: Path, blocks: Sequence[str] = BLOCKS
) -> dict[str, Any]:
    """One run in numbers; None where it did not get so far."""
    none = _nothing(blocks)
    ended = run(scene, path)
    if isinstance(ended, InputError):
        return {**none, "status": f"refused: {ended}"}
    result = getattr(ended, "result", ended)
    if not isinstance(result, RunResult):
        return {**none, "status": str(ended)}
    facts, base, done = run_facts(result), run_facts(truth), isinstance(ended, RunResult)
    seen = result.summary.get("stability") or {}
    row = {**none, "ms": facts.ms_per_step, "offline_s": facts.offline_whole_seconds,
           "atoms": facts.atoms_text, "rows": facts.rows, "radius": seen.get("radius"),
           "growth": seen.get("growth"), "stopped": not done, "steps": facts.steps,
           "status": "done" if done else f"{ended.status.value} at {ended.time:.3g} s "
                     f"in {ended.block}"}  # type: ignore[union-attr]
    if facts.ms_per_step and base.ms_per_step:
        row["speed_up"] = base.ms_per_step / facts.ms_per_step
    if facts.steps > 1:
        row |= phases(measure_errors(truth, result), blocks)
    return row


def _nothing(blocks: Sequence[str]) -> dict[str, Any]:
    row = {f"{m} {when}": None for m in ("joint", *blocks) for when in ("start-up", "steady")}
    more = ("ms", "speed_up", "offline_s", "atoms", "rows", "radius", "growth")
    return {**row, **dict.fromkeys(more), "stopped": True}


def phases(e: Errors, blocks: Sequence[str]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for m in ("joint", *blocks):
        found[f"{m} start-up"], found[f"{m} steady"] = e.start_up.get(m), e.steady.get(m)
    return found


def worst(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The worst seed of each number, and in words how runs ended that stopped."""
    found: dict[str, Any] = {}
    for key in rows[0]:
        values = [r[key] for r in rows if isinstance(r.get(key), int | float)]
        if key in ("stopped", "status", "steps"):
            continue
        if key in ("ms", "speed_up", "offline_s", "rows"):
            found[key] = float(np.median(values)) if values else None
        elif key == "atoms":
            found[key] = rows[0][key]
        else:
            found[key] = max(values) if values else None
    ends = [str(r["status"]) for r in rows if r["stopped"]]
    found["stopped"] = f"{len(ends)}/{len(rows)}"
    found["how"] = ends[0][:90] if ends else ""
    steps = [r["steps"] for r in rows if r["stopped"] and r.get("steps") is not None]
    if steps:
        found["how"] += f"; {min(steps)} to {max(steps)} steps were taken"
    return found


def arguments() -> argparse.Namespace:
    parser = report.options("slider", __doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these methods alone")
    parser.add_argument("--cases", nargs="+", choices=CASES, metavar="NAME",
                        help="these cases outside training alone")
    parser.add_argument("--inside", action="store_true", help="only in training")
    parser.add_argument("--outside", action="store_true", help="only outside of it")
    given = parser.parse_args()
    given.small = {}
    if given.quick:
        given.seeds = 1
        given.small = {"time.end": 1.5e-4, "training.end": 1.5e-4}
        given.only = given.only or ["galerkin", "galerkin, POD"]
    return given


if __name__ == "__main__":
    sys.exit(report.conduct("slider", fill, arguments()))
