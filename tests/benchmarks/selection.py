"""Real selection: few atoms active of all that the basis holds, chosen while the run goes.

    python tests/benchmarks/selection.py [--quick] [--hysteresis H ...] [--out selection.json]

The dictionary is the whole POD basis (cut at its numerical rank). Beside it stand the same number
of atoms without a choice: the leading POD columns, sampled and projected. The second table sets a
selection in each step beside a support that is carried through the run.
"""

import argparse
import sys
import time
from typing import Any

import common
import numpy as np
import report

ROWS = (240, 80)
SOLVERS: dict[str, dict[str, Any]] = {
    "default": {"use": "greedy_gauss_newton"},
    "no hysteresis": {"use": "greedy_gauss_newton", "hysteresis": 0.0},
    "published": {"use": "greedy_gauss_newton", "candidates": "correlated", "hysteresis": 0.0},
}
"""How atoms are chosen."""


def variants(active: tuple[int, int], hysteresis: list[float]) -> dict[str, dict[str, Any]]:
    """Reducer options by name; active: elastic and thermal atoms at once; hysteresis: values
    beside the default one and none."""
    whole, chosen = (None, None), {}
    for name, solver in SOLVERS.items():
        for when, options in (("each step", {}), ("every 10", {"every": 10}),
                              ("each step, from none", {"carried": False})):
            chosen[f"{name}, {when}"] = common.sparse(
                ROWS, whole, active=active, solver=solver, **options)
    del chosen["no hysteresis, each step, from none"]  # there is none without a carried support
    for h in hysteresis:
        chosen[f"hysteresis {h:g}, each step"] = common.sparse(
            ROWS, whole, active=active, solver={**SOLVERS["default"], "hysteresis": h})
    return {
        **chosen,
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
        "solver": "greedy_gauss_newton; published: candidates correlated, hysteresis 0; "
                  "preconditioner none",
        "seeds": given.seeds,
        "errors": "largest over time: angle in rad; elastic (from 0.1 s on) and thermal relative "
                  "to the block's largest change, worse link"}
    cost(out, given)
    if given.pair:
        return
    table = out.table("Selection", iterations=".2f")
    case = common.Case.of(common.scene_at(1280, given.end))
    for name, options in variants(given.active, given.hysteresis).items():
        for seed in given.seeds if options["use"] == "sparse" else given.seeds[:1]:
            run = case.run(options, seed)
            if isinstance(run, common.Trajectory):
                _add(table, case, name, seed, run)
            else:
                table.add(variant=name, seed=seed, status=common.in_words(run))
            report.progress(f"{name}, seed {seed}: {table.rows[-1]}")


CARRIED = 10**9
"""Steps between selections: one, in the first step."""


def cost(out: report.Report, given: argparse.Namespace) -> None:
    """CPU time of the thread, which waits for nobody; windows of all ways in turn.

    Others on the machine still take its caches away: the tenth part of the steps that went best
    tells what is left of that.
    """
    table = out.table("A selection in each step beside a carried support", changes="d")
    case = common.Case.of(common.scene_at(1280, given.end))
    for who in SOLVERS:
        ways = {"each step": {}, "each step, screen off": {"screen": False},
                "carried": {"every": CARRIED}}
        if given.pair:
            del ways["each step, screen off"]
        going = {name: _going(case, given, who, options) for name, options in ways.items()}
        times = {name: np.empty(case.steps - 1) for name in ways}
        for way in going.values():
            way.step()  # the first support, which all of them choose
        with common.no_collector():
            for first in range(0, case.steps - 1, given.window):
                for name, way in going.items():
                    for n in range(first, min(first + given.window, case.steps - 1)):
                        start = time.thread_time()
                        way.step()
                        times[name][n] = 1e3 * (time.thread_time() - start)
        alone = times["carried"]
        for name, way in going.items():
            t, same = times[name], bool(np.array_equal(way.state.x, going["each step"].state.x))
            table.add(
                chosen=who, way=name, median_ms=float(np.median(t)), mean_ms=float(t.mean()),
                tenth_ratio=float(np.quantile(t, 0.1) / np.quantile(alone, 0.1)),
                median_ratio=float(np.median(t) / np.median(alone)),
                mean_ratio=float(t.mean() / alone.mean()),
                changes=way.solver.counters(way.memory)["support_changes"],
                same_end_as_each_step="yes" if same else "no")
        ratio = times["each step"].mean() / alone.mean()
        median = np.median(times["each step"]) / np.median(alone)
        if who != "no hysteresis":  # an ablation of the default
            out.at_most(f"{who}: each step to carried, median", float(median), 2.0)
            out.at_most(f"{who}: each step to carried, mean", float(ratio), 2.0)
        report.progress(f"{who}: {median:.2f} in the median, {ratio:.2f} in the mean")


def _going(
    case: common.Case, given: argparse.Namespace, who: str, options: dict[str, Any]
) -> common.Stepping:
    reducer = common.sparse(
        ROWS, (None, None), active=given.active, solver=SOLVERS[who], **options)
    scene = case.scene.using({"reducer": reducer})
    return common.Stepping.begin(scene, case.model, case.prepared(reducer, given.seeds[0]))


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
    parser.add_argument("--hysteresis", type=float, nargs="+", default=[], metavar="H",
                        help="more values to run with")
    parser.add_argument("--pair", action="store_true",
                        help="only a selection in each step and a carried support, in turn")
    parser.add_argument("--window", type=int, default=100, metavar="N",
                        help="steps of one way before the next one's turn")
    parser.add_argument("--end", type=float, default=4.0, help="s")
    given = parser.parse_args()
    if given.quick:
        given.seeds, given.end, given.active = [1], 0.06, (6, 4)
    given.active = (given.active[0], given.active[1])
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("selection", fill, arguments()))
