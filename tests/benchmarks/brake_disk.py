"""Brake disk: every method over its four fields, in training and outside of it.

    python tests/benchmarks/brake_disk.py [--quick] [--seeds 5] [--only NAME ..]
                                          [--inside | --outside | --projections | --writing]

In training: the run that is repeated. Outside: the same model at 40 km/h, where the car stops
within the run, and at friction 0.4. The rigid stage of each case is its own; only what is learned
(snapshots) comes from 60 km/h and friction 0.7. Atoms without training are made of the tables of
the case's own rigid stage. Projections: how well the atoms hold the states of full order. Writing:
what is not in the time of a step.
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import common  # noqa: F401  # before NumPy: it limits linear algebra to one thread
from modules import brake_projections, brake_writing, report
from modules.method_runs import (
    MEANINGS,
    STOPPED,
    elsewhere_columns,
    file_name,
    full_of,
    over_seeds,
    run,
    seeds_told,
    worst,
)

from sparsemor.core.results.run_result import RunResult
from sparsemor.core.scene.scene import Scene, load
from sparsemor.plugins.comparison.cost import run_facts

BLOCKS = ("disk.elastic", "pad.elastic", "disk.thermal", "pad.thermal")
POD = {"basis": {"use": "pod", "count": 100}, "bases": {"pad.*": {"use": "pod", "count": 20}}}
FEW_POD = {"basis": {"use": "pod", "count": 40}, "bases": {
    "disk.elastic": {"use": "pod", "count": 30}, "pad.*": {"use": "pod", "count": 10}}}
"""ECSW with 100 atoms takes 200 s of CPU and 1.1 GB for tau 1e-2, over ten minutes for 1e-3."""
MANY_POD = {"basis": {"use": "pod", "count": 200}, "bases": {"pad.*": {"use": "pod", "count": 20}}}


def packaged() -> dict[str, Any]:
    """The recommended reducer."""
    own: dict[str, Any] = load("brake_disk").dump()["reducer"]
    return own


def published(**options: Any) -> dict[str, Any]:
    """The published reducer with one draw of rows and centred snapshots, which makes a step cheap
    enough to count seeds."""
    own: dict[str, Any] = load("brake_disk_published").dump()["reducer"]
    centred = {"use": "pod", "centred": True, "complete": True}
    return {**own, "resample": None, "basis": centred, **options}


def atoms_of(reducer: Mapping[str, Any]) -> dict[str, Any]:
    return {key: reducer[key] for key in ("basis", "bases")}


def beside(count: int, pulses: int = 200) -> dict[str, Any]:
    """POD of the disk's temperatures in the training run, beside pulses; else as packaged."""
    free = atoms_of(packaged())
    both = {"use": "dictionary", "orthonormal": True,
            "bases": [{"use": "pod", "count": count}, {**free["basis"], "count": pulses}]}
    return {"use": "galerkin", **free, "basis": both}


ROWS = {"disk.elastic": {"rows": 1200}, "disk.thermal": {"rows": 200},
        "pad.elastic": {"rows": 320}, "pad.thermal": {"rows": 150}}
"""As many as the paper has."""
RINGED = {name: {"rows": 0} if name.startswith("pad") else rows for name, rows in ROWS.items()}
"""Beside all rows around the path, which in the pad are all there are."""
Q_DEIM = {"use": "deim", "method": "qr", "required": False}
RING = {**Q_DEIM, "required": "ring"}
LEADING = {"disk.elastic": {"use": "pod", "centred": True, "count": 400},
           "pad.elastic": {"use": "pod", "centred": True, "count": 140}}
"""As many displacements as are chosen in each step as published, without a choice: choosing among
7018 takes seconds a step. Heat does not feel it."""


def of_the_error(
    atoms: Mapping[str, Any], sampler: Mapping[str, Any], disk: int, pad: int
) -> dict[str, Any]:
    """Rows of D^-1 r: `disk` and `pad` of them a block, beside those that the sampler keeps."""
    return {"use": "sparse", **atoms, "sampler": sampler, "residual": "preconditioned",
            "preconditioner": "none",
            "budgets": {"disk.*": {"rows": disk}, "pad.*": {"rows": pad}}}


def methods() -> dict[str, tuple[dict[str, Any], bool]]:
    """Reducer by name, and whether its rows depend on the seed."""
    drawn = {"use": "lhs", "required": False}
    leading = {"use": "sparse", "residual": "plain", **POD, "preconditioner": "none",
               "budgets": ROWS}
    return {
        "recommended": (packaged(), False),
        "galerkin, POD 100": ({"use": "galerkin", **POD}, False),
        "galerkin, POD 200": ({"use": "galerkin", **MANY_POD}, False),
        "galerkin, POD and training-free": (beside(100), False),
        "deim, POD 100, 400 of force": (
            {"use": "deim", **POD, "force_basis": {"use": "pod", "count": 400}}, False),
        "deim, POD 100, all modes of force": (
            {"use": "deim", **POD, "force_basis": {"use": "pod", "energy": 1.0}}, False),
        "deim, POD 100, 0.9999 of force": (
            {"use": "deim", **POD, "force_basis": {"use": "pod", "energy": 0.9999}}, False),
        "ecsw, POD 30 and 40": (
            {"use": "ecsw", "constant": "weighted", **FEW_POD, "tau": 1e-3}, False),
        "ecsw, POD 100": (
            {"use": "ecsw", "constant": "weighted", **POD, "tau": 1e-2}, False),
        "D^-1 r, Q-DEIM, POD 100": (of_the_error(POD, Q_DEIM, 200, 40), False),
        "D^-1 r, Q-DEIM + ring, POD 100": (of_the_error(POD, RING, 200, 0), False),
        "D^-1 r, Q-DEIM, POD 200": (of_the_error(MANY_POD, Q_DEIM, 400, 40), False),
        "D^-1 r, Q-DEIM, training-free": (
            of_the_error(atoms_of(packaged()), Q_DEIM, 800, 120), False),
        "D^-1 r, Q-DEIM, POD and training-free": (
            of_the_error(atoms_of(beside(100)), Q_DEIM, 700, 120), False),
        "leading atoms, LHS": ({**leading, "sampler": drawn}, True),
        "leading atoms, LHS + ring": (
            {**leading, "sampler": {**drawn, "required": "ring"}, "budgets": RINGED}, True),
        "published heat, UNTF": (published(bases=LEADING), True),
        "published heat, none": (published(bases=LEADING, preconditioner="none"), True),
    }


LEARNED = {"bodies.disk.pose.spin": [0.0, 0.0, 66.667], "bodies.car.pose.spin": [0.0, 0.0, 66.667]}
SLOWER = {key: [0.0, 0.0, 44.444] for key in LEARNED}
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "40 km/h": (SLOWER, {"training.overrides": LEARNED}),
    "mu 0.4": ({"contacts.brake.friction.coefficient": 0.4},
               {"training.overrides": {"contacts.brake.friction.coefficient": 0.7}}),
}
ELSEWHERE = ("recommended", "galerkin, POD 200", "galerkin, POD and training-free",
             "D^-1 r, Q-DEIM, POD 200", "D^-1 r, Q-DEIM, POD and training-free",
             "deim, POD 100, 400 of force", "ecsw, POD 30 and 40", "leading atoms, LHS + ring",
             "published heat, UNTF", "published heat, none")


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": "brake_disk: 10 344 and 900 tetrahedra, 1200 steps of 1 ms, bdf1",
        "seeds": seeds_told(given.seeds), **MEANINGS}
    base = load("brake_disk", given.small)
    folder = Path(tempfile.mkdtemp(prefix="brake-"))
    every = not (given.inside or given.outside or given.projections or given.writing)
    if given.inside or every:
        inside(out, given, base, folder)
    if given.outside or every:
        elsewhere(out, given, base, folder)
    if given.projections or every:
        projections(out, base, folder)
    if given.writing or every:
        writing(out, base, folder)


def chosen(given: argparse.Namespace, names: Sequence[str]) -> list[str]:
    return [n for n in names if not given.only or n in given.only]


def inside(out: report.Report, given: argparse.Namespace, base: Scene, folder: Path) -> None:
    table = out.table("In training")
    truth = full_of(base, folder / "full")
    table.add(method="full", ms=run_facts(truth).ms_per_step)
    for name in chosen(given, list(methods())):
        options, drawn = methods()[name]
        rows = over_seeds(base, truth, folder, BLOCKS, name, options, given.seeds if drawn else 1)
        table.add(method=name, **worst(rows))
        if name == "recommended":
            top = max(largest(r) for r in rows)
            out.at_most("recommended, in training: worst field, start-up included", top, 1e-3)


def elsewhere(out: report.Report, given: argparse.Namespace, base: Scene, folder: Path) -> None:
    table = out.table("Outside training: worst error of each field, whole run")
    for case, (changes, training) in CASES.items():
        scene = base.using(changes)
        truth = full_of(scene, folder / file_name(f"full-{case}"))
        for name in chosen(given, ELSEWHERE):
            options, drawn = methods()[name]
            rows = over_seeds(scene.using(training), truth, folder, BLOCKS, f"{case}-{name}",
                              options, given.seeds if drawn else 1)
            row = worst(rows) | {"status": "; ".join(sorted({str(r["status"]) for r in rows}))}
            table.add(case=case, method=name, **elsewhere_columns(row, BLOCKS),
                      radius=row["radius"])
            report.progress(f"{case}: {table.rows[-1]}")
            if name == "recommended":
                out.at_most(f"recommended, {case}: worst field", max(map(largest, rows)), 1e-3)


def projections(out: report.Report, base: Scene, folder: Path) -> None:
    cases = {"60 km/h, mu 0.7": base} | {
        case: base.using({**changes, **training}) for case, (changes, training) in CASES.items()}
    brake_projections.fill(
        out.table("Best approximation of the states", **dict.fromkeys(cases, ".2g")),
        {case: (scene, full_of(scene, folder / file_name(f"full-{case}-projected")))
         for case, scene in cases.items()},
        packaged(), {f"POD 100 and {n} pulses": beside(100, n)
                     for n in (100, 200)})


def writing(out: report.Report, base: Scene, folder: Path) -> None:
    table = out.table("Beside the steps: ms a step for storing, making full fields, writing them")
    reduced = run(base, folder / "recommended-stored")
    assert isinstance(reduced, RunResult)
    runs = {"full": full_of(base, folder / "full-stored"), "recommended": reduced}
    brake_writing.fill(table, runs, BLOCKS, folder)


def largest(row: Mapping[str, Any]) -> float:
    """Worst error of a field over the whole run; a short one has no start-up of its own."""
    values = [row[f"{b} {when}"] for b in BLOCKS for when in ("start-up", "steady")]
    return STOPPED if row["stopped"] else max(float(v) for v in values if v is not None)


def arguments() -> argparse.Namespace:
    parser = report.options("brake_disk", __doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these methods alone")
    parser.add_argument("--inside", action="store_true", help="only in training")
    parser.add_argument("--outside", action="store_true", help="only outside of it")
    parser.add_argument("--projections", action="store_true", help="only the atoms themselves")
    parser.add_argument("--writing", action="store_true", help="only storing and full fields")
    given = parser.parse_args()
    given.small = {}
    if given.quick:
        given.seeds = 1
        given.small = {"time.end": 0.01, "training.end": 0.01, "bodies.disk.mesh.refine": 0.4,
                       "bodies.pad.mesh.refine": 0.6}
        given.only = given.only or ["recommended"]
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("brake_disk", fill, arguments()))
