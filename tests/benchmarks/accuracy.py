"""Error of Galerkin and of sampled rows against full order, over many random choices of rows.

    python tests/benchmarks/accuracy.py [--quick] [--out accuracy.json]

One training run and one basis a mesh serve all seeds; only the sampled rows differ. The required
rows (joints, heated edges) are kept on top of the sampled ones.
"""

import argparse
import sys

import common
from modules import report

ROWS, ATOMS = (240, 80), (30, 20)
LIMITS = {
    1280: {"angle": 1e-9, "elastic": 1e-8, "thermal": 1e-8},
    20480: {"angle": 1e-8, "elastic": 1e-6, "thermal": 1e-8},
}
"""Wanted of the sparse runs, by triangles a link."""
GALERKIN = {"angle": 1e-9, "elastic": 1e-10, "thermal": 1e-10}
"""Wanted of Galerkin on 1280 triangles, where 20 thermal atoms are all that is above round-off."""
FIELDS = tuple(GALERKIN)


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": "double_pendulum, bdf1, h = 1 ms",
        "rows": f"{ROWS[0]}/{ROWS[1]} elastic/thermal by lhs, and the required ones",
        "atoms": f"{ATOMS[0]}/{ATOMS[1]}, or the numerical rank of the snapshots",
        "runs": "; ".join(f"{m} triangles a link, {end:g} s, seeds 1 to {seeds}"
                          for m, end, seeds in given.runs),
        "errors": "largest over time: angle in rad; elastic (from 0.1 s on) and thermal relative "
                  "to the block's largest change, worse link"}
    summary = out.table("Errors over the seeds")
    each = out.table("Every run")
    for elements, end, seeds in given.runs:
        one_mesh(out, summary, each, elements, end, seeds)


def one_mesh(
    out: report.Report, summary: report.Table, each: report.Table, elements: int, end: float,
    seeds: int,
) -> None:
    report.progress(f"{elements} triangles: full order over {end:g} s")
    case = common.Case.of(common.scene_at(elements, end))
    limits = LIMITS.get(elements, LIMITS[20480])
    whole = case.run(common.galerkin(None, None))
    if isinstance(whole, common.Trajectory):
        each.add(triangles=elements, method="galerkin, all atoms", atoms=whole.atoms_text,
                 **case.errors(whole), ms=whole.ms, status="done")
    run = case.run(common.galerkin(*ATOMS))
    if not isinstance(run, common.Trajectory):
        raise run
    exact = case.errors(run)
    each.add(triangles=elements, method="galerkin", atoms=run.atoms_text, **exact, ms=run.ms,
             status="done")
    for name in FIELDS:
        summary.add(triangles=elements, method="galerkin", field=name, seeds=1,
                    median=exact[name], worst=exact[name], worst_seed=None)
        if elements == 1280:
            out.at_most(f"galerkin {name}, {elements}", exact[name], GALERKIN[name])
    found: dict[int, dict[str, float]] = {}
    failed = 0
    try:
        for seed in range(1, seeds + 1):
            errors = _one_seed(case, each, elements, seed)
            if errors is None:
                failed += 1
            else:
                found[seed] = errors
            report.progress(f"{elements} triangles, seed {seed}: {errors}")
    finally:
        if found:
            _summarise(out, summary, elements, found, limits)
        out.at_most(f"sparse runs that stopped early, {elements}", failed, 0)


def _one_seed(
    case: common.Case, each: report.Table, elements: int, seed: int
) -> dict[str, float] | None:
    """Errors of one sparse run, None if it stopped."""
    run = case.run(common.sparse(ROWS, ATOMS), seed)
    if isinstance(run, common.Trajectory):
        errors = case.errors(run)
        status = "done" if run.failure is None else common.in_words(run.failure)
        each.add(triangles=elements, method="sparse", atoms=run.atoms_text, seed=seed, **errors,
                 ms=run.ms, status=status)
        return errors if run.failure is None else None
    each.add(triangles=elements, method="sparse", seed=seed, status=common.in_words(run))
    return None


def _summarise(
    out: report.Report, summary: report.Table, elements: int,
    found: dict[int, dict[str, float]], limits: dict[str, float],
) -> None:
    for name in FIELDS:
        by_seed = {seed: errors[name] for seed, errors in found.items()}
        worst = max(by_seed, key=lambda seed: by_seed[seed])
        q = report.quantiles(list(by_seed.values()))
        summary.add(triangles=elements, method="sparse", field=name, seeds=len(found),
                    median=q["median"], worst=q["most"], worst_seed=worst)
        out.at_most(f"sparse {name}, {elements}, worst of {len(found)} seeds", q["most"],
                    limits[name])


def arguments() -> argparse.Namespace:
    parser = report.options("accuracy", __doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(30, 20), metavar="N",
                        help="on the coarse and on the fine mesh")
    given = parser.parse_args()
    given.runs = [(1280, 4.0, given.seeds[0]), (20480, 1.0, given.seeds[1])]
    if given.quick:
        given.runs = [(1280, 0.06, 2)]
    given.runs = [run for run in given.runs if run[2] > 0]
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("accuracy", fill, arguments()))
