"""What the choice of rows is worth: every sampler over its rows, with and without required ones.

    python tests/benchmarks/samplers.py [--quick] [--out samplers.json]

Fewer POD atoms than the snapshots hold, on a fixed support: what the atoms leave out is what
sampled rows multiply, so that the choice of rows shows in the error.
"""

import argparse
import sys
from collections.abc import Iterator
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core.status import SolveFailed

BAD = 1e-2
"""Relative error of a field (rad for the angle) that counts as failure."""
SAMPLERS: dict[str, dict[str, Any]] = {
    "lhs": {"use": "lhs"},
    "random": {"use": "random"},
    "leverage": {"use": "leverage"},
    "leverage, top": {"use": "leverage", "method": "top"},
    "deim, qr": {"use": "deim"},
    "deim, greedy": {"use": "deim", "method": "greedy"},
    "s_opt": {"use": "s_opt"},
}
DRAWN = ("lhs", "random", "leverage")
"""Those whose rows depend on the seed."""
VECTORS: dict[str, dict[str, Any]] = {
    "operator, h": {"of": "operator"},
    "operator, 10 h": {"of": "operator", "step": 1e-2},
    "operator, h / 10": {"of": "operator", "step": 1e-4},
    "stiffness alone": {"of": "operator", "step": 1e9},
    "mass alone": {"of": "operator", "step": 1e-9},
    "atoms": {"of": "atoms"},
}
NODES: dict[str, dict[str, Any]] = {
    f"{name}, nodes": {**SAMPLERS[name], "unit": "node"}
    for name in ("lhs", "leverage", "deim, qr", "s_opt")
}


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": f"double_pendulum, 2 x {given.elements} triangles, bdf1, h = 1 ms, "
                 f"{given.end:g} s",
        "atoms": f"{given.atoms[0]}/{given.atoms[1]} POD, nothing selected",
        "rows": "elastic/thermal; kept: the rows of joints and heated edges on top of them",
        "seeds": f"1 to {given.seeds} where rows are drawn, one run where they are not",
        "errors": "largest over time, median and worst of the seeds: elastic (late half, or from "
                  "0.1 s on) and thermal relative to the block's largest change, worse link",
        "a run failed if": f"it could not start, stopped, or a field or an angle is off by more "
                           f"than {BAD:g}"}
    case = common.Case.of(common.scene_at(given.elements, given.end))
    best = case.errors(_run(case, common.galerkin(*given.atoms), 1))
    out.settings["galerkin"] = (
        f"elastic {best['elastic']:.2g}, thermal {best['thermal']:.2g} with the same atoms")
    whole = out.table("Errors over rows")
    for rows, required in _cases(given):
        for name, sampler in {**SAMPLERS, **NODES}.items():
            seeds = given.seeds if name.partition(", ")[0] in DRAWN and "top" not in name else 1
            whole.add(**_judged(case, name, sampler, rows, required, given.atoms, seeds))
        report.progress(f"{rows}, required {required}")
    seen = out.table("What is sampled")
    for rows, required in _cases(given):
        for name in ("deim, qr", "s_opt"):
            for of, options in VECTORS.items():
                sampler = {**SAMPLERS[name], **options}
                found = _judged(case, name, sampler, rows, required, given.atoms, 1)
                seen.add(of=of, **{k: v for k, v in found.items() if "worst" not in k})


def _cases(given: argparse.Namespace) -> Iterator[tuple[tuple[int, int], bool]]:
    for times in given.times:
        for required in (True, False):
            yield (times * given.atoms[0], times * given.atoms[1]), required


def _judged(
    case: common.Case, name: str, sampler: dict[str, Any], rows: tuple[int, int], required: bool,
    atoms: tuple[int, int], seeds: int,
) -> dict[str, Any]:
    """One row of a table: errors over the runs that did not fail."""
    options = {**common.sparse(rows, atoms), "sampler": {**sampler, "required": required}}
    good = []
    for seed in range(1, seeds + 1):
        run = case.run(options, seed)
        if isinstance(run, common.Trajectory) and run.failure is None:
            errors = case.errors(run)
            if all(e <= BAD for e in errors.values()):
                good.append(errors)
    row: dict[str, Any] = {
        "sampler": name, "rows": f"{rows[0]}/{rows[1]}", "required": "kept" if required else "no",
        "runs": seeds, "failed": seeds - len(good)}
    for field in ("elastic", "thermal"):
        values = [e[field] for e in good]
        row[field] = float(np.median(values)) if values else None
        row[f"{field}_worst"] = max(values, default=None)
    return row


def _run(case: common.Case, options: dict[str, Any], seed: int) -> common.Trajectory:
    run = case.run(options, seed)
    if isinstance(run, SolveFailed):
        raise run
    return run


def arguments() -> argparse.Namespace:
    parser = report.options("samplers", __doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--end", type=float, default=1.0, help="s")
    parser.add_argument("--elements", type=int, default=1280, help="triangles a link")
    parser.add_argument("--atoms", type=int, nargs=2, default=(16, 10), metavar="N",
                        help="elastic and thermal atoms")
    parser.add_argument("--times", type=int, nargs="+", default=[1, 2, 4],
                        help="rows for each atom, required ones not counted")
    given = parser.parse_args()
    if given.quick:
        given.seeds, given.end, given.atoms, given.times = 2, 0.06, (6, 4), [2]
        given.elements = 320
    given.atoms = (given.atoms[0], given.atoms[1])
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("samplers", fill, arguments()))
