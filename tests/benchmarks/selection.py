"""Selection of few atoms in each step of a run: its errors and its cost.

    python tests/benchmarks/selection.py [--quick] [--hysteresis H ...] [--out selection.json]

The first tables set a selection in each step, by three sparse solvers, beside a support that is
carried through the run, on five dictionaries. The last one compares ways of selecting on one of
them, the whole POD basis (cut at its numerical rank), with the same number of atoms without a
choice: the leading POD columns, sampled and projected; and with all atoms.
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import common
import numpy as np
from modules import report

from sparsemor.core.scene.scene import load
from sparsemor.core.simulation.stages_before_steps import prepared

ROWS = (240, 80)
GREEDY = {"use": "greedy_gauss_newton"}
PUBLISHED = {"solver": {**GREEDY, "candidates": "correlated"}, "selection": "joint",
             "hysteresis": 0.0}
WAYS: dict[str, dict[str, Any]] = {
    "default": {},
    "no hysteresis": {"hysteresis": 0.0},
    "joint": {"selection": "joint"},
    "published": PUBLISHED,
    "omp": {"solver": "omp"},
    "cosamp": {"solver": "cosamp"},
}
"""Options of the reducer: how atoms are chosen."""
SOLVERS = ("greedy_gauss_newton", "omp", "cosamp")
Q_DEIM = {"use": "deim", "method": "qr"}


@dataclass(frozen=True)
class Dictionary:
    """A dictionary and the number of active atoms: elastic and thermal basis, budgets by block
    pattern, rows; largest ratio of a step with selection to one without that is wanted."""

    bases: tuple[Any, Any]
    budgets: dict[str, dict[str, int]]
    options: dict[str, Any]
    wanted: float = 2.0

    def reducer(self, **options: Any) -> dict[str, Any]:
        elastic, thermal = self.bases
        return {"use": "sparse", "residual": "plain", "basis": elastic,
                "bases": {"*.thermal": thermal}, "preconditioner": "none",
                "budgets": self.budgets, **self.options, **options}


def _pendulum(elastic: Any, thermal: Any, active: tuple[int, int], sampler: Any) -> Dictionary:
    budgets = {f"*.{field}": {"rows": rows, "atoms": atoms} for field, rows, atoms in zip(
        ("elastic", "thermal"), ROWS, active, strict=True)}
    return Dictionary((elastic, thermal), budgets, {"sampler": sampler})


def _mixed(pod: int, modal: int) -> dict[str, Any]:
    return {"use": "dictionary", "bases": [{"use": "pod", "count": pod},
                                           {"use": "modal", "count": modal}]}


def _corrected(modal: int) -> dict[str, Any]:
    return {"use": "modal", "count": modal, "correction": True}


def dictionaries(active: tuple[int, int]) -> dict[str, Dictionary]:
    """The slider's rows are those of D^-1 r by Q-DEIM with the ring of nodes along its path, as in
    its packaged scene; those of the pendulum are drawn by LHS for the POD, else Q-DEIM's."""
    weighted = {"use": "pod", "count": 150, "weights": "inverse_sqrt_norm"}
    return {
        "POD": _pendulum({"use": "pod"}, {"use": "pod"}, active, {"use": "lhs"}),
        "POD + modal": _pendulum(_mixed(30, 30), _mixed(20, 20), (30, 20), Q_DEIM),
        "POD + modal + static": _pendulum(
            {"use": "dictionary"}, {"use": "dictionary"}, (20, 10), Q_DEIM),
        "modal + correction": _pendulum(_corrected(60), _corrected(40), (20, 10), Q_DEIM),
        "slider_plate, POD": Dictionary(
            (weighted, weighted),
            {"plate.*": {"rows": 300, "atoms": 60}, "slider.*": {"rows": 300, "atoms": 10}},
            {"sampler": {**Q_DEIM, "required": "ring"}, "residual": "preconditioned"}, 6.0),
    }


def slider() -> common.Case:
    """The packaged slider on a plate. Its bodies follow the rigid stage: no rigid unknowns."""
    scene = load("slider_plate")
    model, offline = prepared(scene, common.Cache(), common.new_manager())
    steps = round(scene.time.end / scene.time.step)
    reference = {n: offline.snapshots(n).T[: steps + 1] for n in model.reducible()}
    return common.Case(scene, model, offline, reference, steps)


def variants(active: tuple[int, int], hysteresis: list[float]) -> dict[str, dict[str, Any]]:
    """Reducer options by name; active: elastic and thermal atoms at once; hysteresis: values
    beside the default one and none."""
    whole, chosen = (None, None), {}
    for name, options in WAYS.items():
        for when, more in (("each step", {}), ("every 10", {"every": 10}),
                           ("each step, from none", {"carried": False})):
            if when == "each step" or name in ("default", "published"):
                chosen[f"{name}, {when}"] = common.sparse(
                    ROWS, whole, active=active, **options, **more)
    for h in hysteresis:
        chosen[f"hysteresis {h:g}, each step"] = common.sparse(
            ROWS, whole, active=active, hysteresis=h)
    return {
        **chosen,
        "leading atoms, sampled": common.sparse(ROWS, active),
        "leading atoms, galerkin": common.galerkin(*active),
        "all atoms, sampled": common.sparse(ROWS, whole),
    }


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "scene": f"double_pendulum, 2 x 1280 triangles, bdf1, h = 1 ms, {given.end:g} s; "
                 "slider_plate as packaged",
        "active": f"{given.active[0]}/{given.active[1]} elastic/thermal atoms of the whole POD "
                  "basis, if not said otherwise",
        "rows": f"{ROWS[0]}/{ROWS[1]} by lhs, and the required ones, if not said otherwise",
        "ways": "default: selection blocks, hysteresis 0.3; joint: selection joint; published: "
                "joint, candidates correlated, hysteresis 0; all with polish",
        "seeds": given.seeds,
        "errors": "largest over time: angle in rad; elastic (from 0.1 s on) and thermal relative "
                  "to the block's largest change, worse link"}
    pendulum = common.Case.of(common.scene_at(1280, given.end))
    cost(out, given, pendulum)
    if given.pair:
        return
    table = out.table("Selection", iterations=".2f")
    for name, options in variants(given.active, given.hysteresis).items():
        for seed in given.seeds if options["use"] == "sparse" else given.seeds[:1]:
            run = pendulum.run(options, seed)
            if isinstance(run, common.Trajectory):
                _add(table, pendulum, name, seed, run)
            else:
                table.add(variant=name, seed=seed, status=common.in_words(run))
            report.progress(f"{name}, seed {seed}: {table.rows[-1]}")


CARRIED = 10**9
"""Steps between selections: one, in the first step."""


def cost(out: report.Report, given: argparse.Namespace, pendulum: common.Case) -> None:
    """CPU time of the thread, which waits for nobody; windows of all ways in turn.

    Others on the machine still take its caches away: the tenth part of the steps that went best
    tells what is left of that.
    """
    table = out.table("A selection in each step beside a carried support", changes="d")
    for name, dictionary in dictionaries(given.active).items():
        if given.only and name not in given.only:
            continue
        case = slider() if name.startswith("slider") else pendulum
        ways = {solver: dictionary.reducer(solver={"use": solver}) for solver in SOLVERS}
        ways["carried"] = dictionary.reducer(every=CARRIED)
        steps = min(given.timed, case.steps - 1)
        times, changes = _timed(case, given.seeds[0], ways, steps, given.window)
        alone = times["carried"]
        for way, t in times.items():
            run = None if given.pair else case.run(ways[way], given.seeds[0])
            errors = case.errors(run) if isinstance(run, common.Trajectory) else {}
            table.add(
                dictionary=name, selected_by=way, median_ms=float(np.median(t)),
                median_ratio=float(np.median(t) / np.median(alone)),
                mean_ratio=float(t.mean() / alone.mean()),
                tenth_ratio=float(np.quantile(t, 0.1) / np.quantile(alone, 0.1)),
                changes=changes[way], **errors)
            report.progress(f"{table.rows[-1]}")
        greedy = times[SOLVERS[0]]
        out.at_most(f"{name}: each step to carried, median",
                    float(np.median(greedy) / np.median(alone)), dictionary.wanted)
        for other in SOLVERS[1:]:
            out.at_most(f"{name}: {other} to greedy, median",
                        float(np.median(times[other]) / np.median(greedy)), 5.0)


def _timed(
    case: common.Case, seed: int, ways: dict[str, Any], steps: int, window: int
) -> tuple[dict[str, Any], dict[str, int]]:
    """Milliseconds of each step of each way, and its exchanges of supports in these steps."""
    going = {name: _going(case, seed, reducer) for name, reducer in ways.items()}
    times = {name: np.empty(steps) for name in ways}
    for way in going.values():
        way.step()  # the first support
    clock: Callable[[], float] = time.thread_time
    with common.no_collector():
        for first in range(0, steps, window):
            for name, way in going.items():
                for n in range(first, min(first + window, steps)):
                    start = clock()
                    way.step()
                    times[name][n] = 1e3 * (clock() - start)
    return times, {name: way.solver.counters(way.memory)["support_changes"]
                   for name, way in going.items()}


def _going(case: common.Case, seed: int, reducer: dict[str, Any]) -> common.Stepping:
    scene = case.scene.using({"reducer": reducer})
    return common.Stepping.begin(scene, case.model, case.prepared(reducer, seed))


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
                        help="only times of a selection in each step and of a carried support")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="dictionaries")
    parser.add_argument("--timed", type=int, default=1000, metavar="N", help="steps to time")
    parser.add_argument("--window", type=int, default=50, metavar="N",
                        help="steps of one way before the next one's turn")
    parser.add_argument("--end", type=float, default=4.0, help="s")
    given = parser.parse_args()
    if given.quick:
        given.seeds, given.end, given.active, given.only = [1], 0.06, (6, 4), ["POD"]
    given.active = (given.active[0], given.active[1])
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("selection", fill, arguments()))
