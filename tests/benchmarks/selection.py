"""Real selection: few atoms active of all that the basis holds, chosen while the run goes.

    python tests/benchmarks/selection.py [--quick] [--out selection.json]

The dictionary is the whole POD basis (cut at its numerical rank). Beside it stand the same number
of atoms without a choice: the leading POD columns, sampled and projected.
"""

import argparse
import sys
from typing import Any

import common
import report

ROWS = (240, 80)


def variants(active: tuple[int, int]) -> dict[str, dict[str, Any]]:
    """Reducer options by name; active: elastic and thermal atoms at once."""
    whole = (None, None)
    all_enter = {"use": "greedy_gauss_newton", "candidates": "all"}
    return {
        "carried, each step": common.sparse(ROWS, whole, active=active),
        "from none, each step": common.sparse(ROWS, whole, active=active, carried=False),
        "carried, every 10": common.sparse(ROWS, whole, active=active, every=10),
        "candidates all, each step": common.sparse(ROWS, whole, active=active, solver=all_enter),
        "candidates all, every 10": common.sparse(
            ROWS, whole, active=active, solver=all_enter, every=10),
        "leading atoms, sampled": common.sparse(ROWS, active),
        "leading atoms, galerkin": common.galerkin(*active),
        "all atoms, sampled": common.sparse(ROWS, whole),
    }


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": f"double_pendulum, 2 x 1280 triangles, bdf1, h = 1 ms, {given.end:g} s",
        "active": f"{given.active[0]}/{given.active[1]} elastic/thermal atoms of the whole POD "
                  "basis, first support empty",
        "rows": f"{ROWS[0]}/{ROWS[1]} by lhs, and the required ones",
        "solver": "greedy_gauss_newton, its defaults where not said; preconditioner none",
        "seeds": given.seeds,
        "errors": "largest over time: angle in rad; elastic (from 0.1 s on) and thermal relative "
                  "to the block's largest change, worse link"}
    table = out.table("Selection", iterations=".2f")
    case = common.Case.of(common.scene_at(1280, given.end))
    for name, options in variants(given.active).items():
        for seed in given.seeds if options["use"] == "sparse" else given.seeds[:1]:
            run = case.run(options, seed)
            if isinstance(run, common.Trajectory):
                _add(table, case, name, seed, run)
            else:
                table.add(variant=name, seed=seed, status=common.in_words(run))
            report.progress(f"{name}, seed {seed}: {table.rows[-1]}")


def _add(
    table: report.Table, case: common.Case, name: str, seed: int, run: common.Trajectory
) -> None:
    in_use = {**run.atoms, **run.active}
    steps = len(run.x) - 1
    table.add(
        variant=name, seed=seed, **case.errors(run), ms=run.ms, iterations=run.iterations,
        changes=run.support_changes, active=_pair(in_use, ".3g"), atoms=_pair(run.atoms, "d"),
        steps=steps, status="done" if run.failure is None else common.in_words(run.failure))


def _pair(by_block: dict[str, Any], form: str) -> str:
    """Elastic/thermal, the larger link."""
    fields = ("elastic", "thermal")
    return "/".join(format(max(v for n, v in by_block.items() if n.endswith(f)), form)
                    for f in fields)


def arguments() -> argparse.Namespace:
    parser = report.options("selection", __doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--active", type=int, nargs=2, default=(15, 10), metavar="N",
                        help="elastic and thermal atoms")
    parser.add_argument("--end", type=float, default=4.0, help="s")
    given = parser.parse_args()
    if given.quick:
        given.seeds, given.end, given.active = [1], 0.06, (6, 4)
    given.active = (given.active[0], given.active[1])
    return given


if __name__ == "__main__":
    sys.exit(report.conduct("selection", fill, arguments()))
