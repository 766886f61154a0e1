"""Cost as the mesh grows: the brake disk from 10 thousand tetrahedra on, heat alone to a million;
a steel plate with nonlinear heat to 81 thousand triangles.

    python tests/benchmarks/scaling.py [--quick] [--refine 1 1.5 ..] [--heat 1 1.9 ..]
        [--nonlinear 16 32 90 ..] [--chart scaling.png] [--out scaling.json]
        [--counts disk.elastic=40,disk.thermal=200]

Every method on every mesh is a process of its own, so that what it holds at its largest is its own.
Windows of the methods of one mesh take turns, and those of the reduced models of all meshes once
more at the end. Times are CPU time of one thread.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import common  # noqa: F401  one thread, before NumPy is loaded
import numpy as np
from modules import report, scaling_nonlinear
from modules.scaling_chart import chart
from modules.scaling_fits import fits, join
from modules.scaling_meshes import TOLERANCE, Mesh, Worker

Q_DEIM = {"use": "deim", "method": "qr"}
FULL: dict[str, dict[str, Any]] = {
    "full": {},
    "full, splu": {"linear_solver": "splu"},
    "full, iterative": {"linear_solvers": {"*.thermal": "cg", "*.elastic": "amg"}},
}
"""Overrides. The first has its solvers chosen by `auto`."""
FIXED = {"disk.elastic": 30, "disk.thermal": 40, "pad.elastic": 10, "pad.thermal": 10}


def bases(counts: Mapping[str, int]) -> dict[str, Any]:
    return {"basis": "pod", "bases": {n: {"use": "pod", "count": k} for n, k in counts.items()}}


def methods(counts: Mapping[str, int]) -> dict[str, dict[str, Any]]:
    """Reducer options at so many atoms a block."""
    pod = bases(counts)
    twice = {n: {"rows": 2 * k} for n, k in counts.items()}
    # the ring is all of the pad: there is no row left to choose
    beside = {n: {"rows": 0 if n.startswith("pad") else 2 * k} for n, k in counts.items()}
    return {
        "galerkin": {"use": "galerkin", **pod},
        "deim": {"use": "deim", **pod},
        "ecsw": {"use": "ecsw", "constant": "weighted", "tau": 1e-3, **pod},
        "sparse": {"use": "sparse", **pod, "sampler": {**Q_DEIM, "required": False},
                   "residual": "preconditioned", "budgets": twice},
        "sparse, ring": {"use": "sparse", "residual": "plain", **pod,
                         "sampler": {**Q_DEIM, "required": "ring"},
                         "budgets": beside},
    }


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": "brake_disk, bdf1, h = 1 ms, mesh.refine of disk and pad; heat: thermal alone",
        "steps": f"{given.steps} of the 1200 (heat {given.heat_steps}); trained on all of them",
        "windows": f"full: {given.full_windows} of {given.full_steps} steps; reduced: "
                   f"{given.windows} passes over all steps; median of medians, CPU ms; exponents "
                   "are of the least: other work on the machine only adds",
        "atoms": ", ".join(f"{n} {k}" for n, k in given.atoms.items()),
        "sparse": "Q-DEIM rows of D^-1 r, two an atom; ring: plain rows, with all around the path",
        "ecsw": f"tau 1e-3, up to {given.ecsw_up_to} tetrahedra (not run beyond)",
        "memory": "largest of the process, GB; Python and its libraries are `base` of it; foretold "
                  "from the counts of the meshes, told once the scene was assembled",
        "errors": "largest distance from full order over the largest change, worst block"}
    tables = {name: out.table(title, **formats) for name, title, formats in (
        ("offline", "Training: wall seconds, and its peak, GB", {}),
        ("steps", "Milliseconds a step", {"iterations": ".2f"}),
        ("nonlinear", "Nonlinear heat, 12 atoms: ms/step", {"iterations": ".2f", "error": ".1e"}),
        ("fits", "Exponents", {"exponent": ".3f"}),
        ("solvers", "Linear solvers of the disk's blocks", {}),
        ("atoms", f"POD atoms for {TOLERANCE:g}: projection, by steps trained on", {}),
        ("whole", "The same over longer runs", {}),
        ("enough", f"Galerkin with the atoms for {TOLERANCE:g}", {}),
        ("given", "Galerkin with given atoms: error of each block", {}))}
    kept: list[Worker] = []
    try:
        if given.join:
            join(given.join, tables)
            return
        for mesh in meshes(given):
            one_mesh(mesh, given, tables, kept)
        for refine in given.whole:
            trained(Mesh(refine, "both", given.whole_steps), tables["offline"], tables["whole"])
        scaling_nonlinear.measure(
            tables["nonlinear"], given.nonlinear, given.nonlinear_steps, given.windows)
        for number in range(1, given.windows):
            report.progress(f"reduced models of all meshes, pass {number + 1}")
            for w in kept:
                if w.method not in FULL:
                    w.window(w.mesh.steps)
    finally:
        for w in kept:
            w.end()
        conclude(out, kept, tables)
        if given.chart is not None:
            chart(tables["steps"].rows, given.chart)


def meshes(given: argparse.Namespace) -> Iterator[Mesh]:
    for name, refines in (("both", given.refine), ("heat", given.heat)):
        for refine in refines:
            yield Mesh(refine, name, given.steps if name == "both" else given.heat_steps)


def one_mesh(
    mesh: Mesh, given: argparse.Namespace, tables: Mapping[str, report.Table], kept: list[Worker]
) -> None:
    """Its workers, added to `kept` one by one: full order ends here, reduced models go on."""
    if not trained(mesh, tables["offline"], tables["atoms"]):
        return
    entire = [name for name in FULL if name in given.only]
    for name in entire:
        kept.append(Worker(mesh, name, reducer="full", changes=changes(FULL[name], mesh)))
    own = kept[len(kept) - len(entire):]
    for _ in range(given.full_windows):
        for w in own:
            w.window(given.full_steps)
    for w in own:
        w.end()
    counts = {n: k for n, k in given.atoms.items() if n in mesh.facts["unknowns"]}
    for name, options in methods(counts).items():
        small = mesh.facts["tetrahedra"] <= given.ecsw_up_to
        if name in given.only and (small or name != "ecsw"):
            kept.append(Worker(mesh, name, reducer=options, errors=True))
            kept[-1].window(mesh.steps)  # at once: an interrupted run has something of each
    if mesh.field == "both" and mesh.facts["tetrahedra"] <= given.enough_up_to:
        enough(mesh, given, tables["enough"])
    for counts in given.counts:
        w = galerkin(mesh, {n: k for n, k in counts.items() if n in mesh.facts["unknowns"]})
        tables["given"].add(
            **mesh.named, method="galerkin", atoms=", ".join(f"{n} {k}" for n, k in counts.items()),
            **w.facts.get("errors", {}), ms=w.ms[0] if w.ms else None,
            status=w.facts.get("failed", "done"))


def trained(mesh: Mesh, offline: report.Table, atoms: report.Table) -> bool:
    """Its training run, told in the tables; False where there is none."""
    trainer = Worker(mesh, "training")
    trainer.end()
    if not trainer.well:
        offline.add(fields=mesh.field, refine=mesh.refine, status=trainer.facts["failed"])
        return False
    mesh.facts = trainer.facts
    offline.add(**mesh.named, refine=mesh.refine, steps=mesh.steps, **{
        k: mesh.facts["spent"].get(k, 0.0) for k in ("rigid_stage", "surface_loads", "training")},
        peak=mesh.facts["peak"], status="done")
    for name, counts in mesh.facts["counts"].items():
        atoms.add(**mesh.named, block=name, **{
            f"{mesh.steps >> j}": counts[j] for j in reversed(range(len(counts)))})
    return True


def changes(overrides: dict[str, Any], mesh: Mesh) -> dict[str, Any]:
    """Without the patterns of fields that the mesh's bodies do not have."""
    if mesh.field == "heat" and "linear_solvers" in overrides:
        return {"linear_solvers": {"*.thermal": overrides["linear_solvers"]["*.thermal"]}}
    return overrides


def enough(mesh: Mesh, given: argparse.Namespace, table: report.Table) -> None:
    """Galerkin with the atoms that the projection needs, and more until the run holds it too."""
    counts = {n: c[0] for n, c in mesh.facts["counts"].items()}
    for tried in range(1, 4):
        w = galerkin(mesh, counts)
        errors = w.facts.get("errors", {})
        table.add(**mesh.named, tried=tried, **counts, error=max(errors.values(), default=None),
                  ms=w.ms[0] if w.ms else None, status=w.facts.get("failed", "done"))
        short = [n for n, e in errors.items() if e > TOLERANCE]
        if not short:
            return
        for n in short:
            counts[n] = min(mesh.steps, int(np.ceil(1.15 * counts[n])) + 1)


def galerkin(mesh: Mesh, counts: Mapping[str, int]) -> Worker:
    """One pass over all steps at so many atoms a block."""
    w = Worker(mesh, "galerkin", reducer={"use": "galerkin", **bases(counts)}, errors=True)
    w.window(mesh.steps)
    w.end()
    return w


def conclude(
    out: report.Report, workers: Sequence[Worker], tables: Mapping[str, report.Table]
) -> None:
    for w in workers:
        timed = report.quantiles(w.ms) if w.ms else {}
        tables["steps"].add(
            **w.mesh.named, method=w.method, ms=timed.get("median"), least=timed.get("least"),
            most=timed.get("most"), iterations=w.iterations or None,
            peak=w.facts.get("peak"), base=w.facts.get("base"),
            precheck_memory=w.facts.get("foretold"), told=w.facts.get("told"),
            prepare_s=w.facts.get("prepare_s"), solved=w.facts.get("reduced"),
            rows=w.facts.get("rows"), elements=w.facts.get("elements"),
            error=max(w.facts.get("errors", {}).values(), default=None),
            status=w.facts.get("failed", "done"))
        if "solvers" in w.facts:
            tables["solvers"].add(**w.mesh.named, method=w.method, **{
                n: s for n, s in w.facts["solvers"].items() if n.startswith("disk")})
    fits(out, tables)


def counts_of(text: str) -> dict[str, int]:
    """`disk.elastic=40,disk.thermal=200`, the other blocks as fixed."""
    told = {n.strip(): int(k) for n, k in (part.split("=") for part in text.split(","))}
    if unknown := set(told) - set(FIXED):
        raise argparse.ArgumentTypeError(f"no block is called {', '.join(sorted(unknown))}")
    return FIXED | told


def arguments() -> argparse.Namespace:
    parser = report.options("scaling", __doc__)
    parser.add_argument("--refine", type=float, nargs="*", default=[1.0, 1.4, 1.9, 3.07])
    parser.add_argument("--heat", type=float, nargs="*", default=[1.0, 1.9, 3.07, 4.62])
    parser.add_argument("--whole", type=float, nargs="*", default=[1.0, 1.4])
    parser.add_argument("--whole-steps", type=int, default=1200)
    parser.add_argument("--only", nargs="+", choices=[*FULL, *methods(FIXED)],
                        default=[*FULL, *methods(FIXED)])
    parser.add_argument("--steps", type=int, default=240)
    parser.add_argument("--heat-steps", type=int, default=60)
    parser.add_argument("--nonlinear", type=int, nargs="*", default=[16, 32, 90], metavar="CELLS",
                        help="cells over the height of hot_plate: 10 CELLS^2 triangles")
    parser.add_argument("--nonlinear-steps", type=int, default=40)
    parser.add_argument("--windows", type=int, default=5)
    parser.add_argument("--full-windows", type=int, default=3)
    parser.add_argument("--full-steps", type=int, default=3)
    parser.add_argument("--ecsw-up-to", type=int, default=100_000, metavar="TETRAHEDRA")
    parser.add_argument("--enough-up-to", type=int, default=100_000, metavar="TETRAHEDRA")
    parser.add_argument("--counts", type=counts_of, action="append", default=[],
                        metavar="BLOCK=ATOMS,..", help="Galerkin with these atoms too, once each")
    parser.add_argument("--join", type=Path, nargs="+", metavar="JSON",
                        help="measure nothing, put the tables of earlier runs together")
    parser.add_argument("--chart", type=Path, help="draw the chart to this file (.png, .svg)")
    given = parser.parse_args()
    given.atoms = FIXED
    if given.quick:
        given.refine, given.heat, given.steps, given.heat_steps = [0.4, 0.6], [], 16, 16
        given.nonlinear, given.nonlinear_steps = [4, 8], 16
        given.whole, given.only = [], ["full", "galerkin", "sparse"]
        given.windows, given.full_windows, given.full_steps = 2, 1, 2
        given.atoms = {n: min(k, 6) for n, k in FIXED.items()}
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("scaling", fill, arguments()))
