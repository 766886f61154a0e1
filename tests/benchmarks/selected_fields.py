"""Atoms selected in each step in one field or both, beside the best ones, on random scenes.

    python tests/benchmarks/selected_fields.py [FIRST LAST] [--fields both] [--solvers omp,cosamp]

Each block has the 16 leading POD atoms of the run itself, of which 8 are active in each step.
*best* is the error of the 8 best atoms for the true state of each step, the larger one of the
bodies. Other columns are relative to it: of runs on all 16 atoms, on selected ones, on the best
ones for the true state (*forced*), and on atoms selected by rows of temperatures that count what
their error e causes in displacements (*weighed*): |e|^2 + w^2 |K^-1 G e|^2, with the quotient w of
the best errors, K and m. Errors below 1e-9 are left out. Last: shares of scenes and largest ratios.
"""

import argparse
import sys
from collections.abc import Mapping
from typing import Any
from unittest.mock import patch

import common
import numpy as np
from errors.random_estimates import random_scene
from modules import report
from scipy.sparse.linalg import splu

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.stages_before_steps import prepared
from sparsemor.core.status import SolveFailed
from sparsemor.reducers.sparse import step_solver
from sparsemor.reducers.sparse.sampled_block import CompressedRows
from sparsemor.reducers.sparse.supported_steps import SparseStepper

ATOMS, ACTIVE, LEAST = 16, 8, 1e-9
FIELDS = {"elastic": ("*.elastic",), "thermal": ("*.thermal",), "both": ("*",)}
States = Mapping[str, FloatArray]
"""Block -> states (steps + 1, n)."""


def reducer(blocks: tuple[str, ...], solver: str = "greedy_gauss_newton") -> dict[str, Any]:
    """Selection in the blocks of these patterns, by D^-1 r in all rows."""
    return {"use": "sparse", "residual": "preconditioned", "solver": solver,
            "basis": {"use": "pod", "count": ATOMS},
            "budgets": {pattern: {"atoms": ACTIVE} for pattern in blocks}}


class Scenario:
    """One scene: its full-order states, and runs with errors relative to the largest change."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene.using({"training": {"end": scene.time.end}})
        self.model, self.offline = prepared(self.scene, common.Cache(), common.new_manager())
        self.steps = round(scene.time.end / scene.time.step)
        x, solver = self.states("full")
        self.true = {n: x[:, solver.layout[n]] for n in self.model.reducible()}
        self.size = {n: float(np.linalg.norm(r - r[0], axis=1).max()) for n, r in self.true.items()}

    def states(
        self, options: Any, supports: Mapping[str, BoolArray] | None = None
    ) -> tuple[FloatArray, Any]:
        """Unknowns (steps + 1, n) of a run, with the supports (steps + 1, k) of each step where
        they are given."""
        case = common.Case(self.scene, self.model, self.offline, {}, self.steps)
        solver = case.prepared(options)
        way = common.Stepping.begin(self.scene.using({"reducer": options}), self.model, solver)
        x = [way.state.x]
        for i in range(1, self.steps + 1):
            if supports is not None:
                memory = way.memory
                memory.supports = {n: supports[n][i] for n in memory.supports}
                memory.current, memory.step = None, 1  # the only selection is in step 0
            way.step()
            x.append(way.state.x)
        return np.array(x), solver

    def errors(self, x: FloatArray, solver: Any) -> dict[str, float]:
        """Block -> largest error of a run."""
        found = {}
        for n, true in self.true.items():
            d = solver.dictionaries[n]
            error = x[:, solver.layout[n]] @ d.atoms.T + d.offset - true
            found[n] = float(np.linalg.norm(error, axis=1).max()) / (self.size[n] or 1.0)
        return found

    def best(self, solver: Any) -> tuple[dict[str, float], dict[str, BoolArray]]:
        """Block -> error of the best atoms for the true state of each step, and their supports."""
        errors, supports = {}, {}
        for n, true in self.true.items():
            d = solver.dictionaries[n]
            c = (true - d.offset) @ d.atoms
            active = np.ones(c.shape, dtype=np.bool_)
            rest = c.shape[1] - min(ACTIVE, c.shape[1])
            if rest:
                np.put_along_axis(active, np.argsort(np.abs(c), axis=1)[:, :rest], False, axis=1)
            error = np.linalg.norm(true - d.offset - (c * active) @ d.atoms.T, axis=1).max()
            errors[n], supports[n] = float(error) / (self.size[n] or 1.0), active
        return errors, supports

    def weights(self, solver: Any, best: Mapping[str, float]) -> dict[str, FloatArray]:
        """Thermal block -> L (k, k) with |L c|^2 = |e|^2 + w^2 |K^-1 G e|^2 for e = A c."""
        found = {}
        for m in self.model.separated.moving:
            ops, thermal = m.operators, m.thermal
            if ops is None or ops.coupling is None or thermal not in best:
                continue
            A = solver.dictionaries[thermal].atoms
            caused = splu(ops.stiffness.tocsc()).solve(np.asarray(ops.coupling @ A))
            absolute = {n: max(best[n], LEAST) * self.size[n] for n in (thermal, m.elastic)}
            w = absolute[thermal] / absolute[m.elastic] if absolute[m.elastic] else 0.0
            found[thermal] = np.linalg.qr(np.vstack([np.eye(A.shape[1]), w * caused]), mode="r")
        return found


def weighed_rows(weights: Mapping[str, FloatArray]) -> Any:
    """In place of `CompressedRows`: the rows of D^-1 r of some blocks times these matrices."""

    class Weighed:
        @staticmethod
        def from_atoms(
            model: Any, offline: Any, name: str, *rest: Any, **more: Any
        ) -> CompressedRows:
            rows = CompressedRows.from_atoms(model, offline, name, *rest, **more)
            L = weights.get(name)
            return rows if L is None else CompressedRows(L @ rows.left, L @ rows.B)

    return patch.object(step_solver, "CompressedRows", Weighed)


def ratios(scene: Scene, fields: str, solvers: list[str]) -> dict[str, dict[str, float]]:
    """Field -> best error, and the errors of all runs relative to it, by column. Raises
    InputError where no atoms can be selected."""
    s, selecting = Scenario(scene), reducer(FIELDS[fields])
    runs = {"all": s.errors(*s.states(reducer(())))}
    for solver in solvers:
        x, made = s.states(reducer(FIELDS[fields], solver))
        runs[solver] = s.errors(x, made)
        if not isinstance(made, SparseStepper):
            return {}
    best, supports = s.best(made)
    runs["forced"] = s.errors(*s.states(selecting, supports))
    if fields == "both":
        with weighed_rows(s.weights(made, best)):
            runs["weighed"] = s.errors(*s.states(selecting))
    found = {}
    for field in ("elastic", "thermal"):
        own = [n for n in best if n.endswith(field) and s.size[n]]
        least = max((best[n] for n in own), default=0.0)
        if fields in (field, "both") and least > LEAST:
            found[field] = {"best": least} | {
                name: max(e[n] for n in own) / least for name, e in runs.items()}
    return found


def fill(out: report.Report, given: argparse.Namespace) -> None:
    solvers, rows = given.solvers.split(","), list[dict[str, Any]]()
    columns = ["all", *solvers, "forced", *(["weighed"] if given.fields == "both" else [])]
    out.settings |= {"scenes": f"random, {given.first} to {given.last - 1}",
                     "selected": f"{ACTIVE} of {ATOMS} atoms in {given.fields}"}
    table = out.table("Errors relative to the best", best=".1e", **dict.fromkeys(columns, ".2g"))
    for seed in range(given.first, given.last):
        kind, scene = random_scene(seed)
        try:
            found = ratios(scene, given.fields, solvers)
        except (InputError, SolveFailed) as error:
            report.progress(f"{seed} {kind}: {str(error)[:90]}")
            continue
        for field, row in found.items():
            rows.append({"scene": f"{seed} {kind}", "field": field, **row})
            table.add(**rows[-1])
            report.progress(f"{rows[-1]}")
    shares = out.table("All scenes", median=".2g", largest=".2g")
    for field in dict.fromkeys(row["field"] for row in rows):
        for c in columns:
            r = np.array([row[c] for row in rows if row["field"] == field])
            shares.add(field=field, run=c, scenes=len(r), at_most_3=f"{np.mean(r <= 3.0):.0%}",
                       at_most_10=f"{np.mean(r <= 10.0):.0%}", median=float(np.median(r)),
                       largest=float(r.max()))


def arguments() -> argparse.Namespace:
    parser = report.options("selected_fields", __doc__)
    parser.add_argument("first", type=int, nargs="?", default=0)
    parser.add_argument("last", type=int, nargs="?", default=60)
    parser.add_argument("--fields", choices=[*FIELDS], default="both")
    parser.add_argument("--solvers", default="greedy_gauss_newton")
    given = parser.parse_args()
    if given.quick:
        given.first, given.last = 1, 2
    return given


if __name__ == "__main__":
    sys.exit(report.run_plan("selected_fields", fill, arguments()))
