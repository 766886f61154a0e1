"""How often each sparse solver finds the true support, and what each makes of a pendulum.

    python tests/benchmarks/recovery.py [--quick] [--packaged | --constants | --screening]
                                        [--out recovery.json]

Each column is a unit vector at a given cosine to the one before it (0: independent Gaussian
columns). The right-hand side is an exact combination of a few of them, with coefficients of size
1 to 2 of either sign; the start is empty. What a solver is told is how many there are.
--packaged: the recovered scenes over their whole runs; --constants: of sampled rows on complete
bases; --screening: columns that a safe rule excludes; each instead of the rest. The pendulum has
two links of 320 triangles; each solver chooses some atoms of the whole POD basis.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import common
import numpy as np
from modules import recovered_scenes, report, row_constants, screening

from sparsemor.core import SparseSolver
from sparsemor.core.errors import InputError
from sparsemor.core.registry.registry import Registry
from sparsemor.core.status import Status
from sparsemor.core.testing.sparse_problems import LeastSquares, chained, empty_start

PUBLISHED = {"candidates": "correlated"}
SOLVERS: dict[str, tuple[str, dict[str, Any]]] = {
    "greedy_gauss_newton": ("greedy_gauss_newton", PUBLISHED),
    "greedy_gauss_newton, growth: 1": ("greedy_gauss_newton", {**PUBLISHED, "growth": 1}),
    "omp": ("omp", {}),
    "cosamp": ("cosamp", {}),
    "basis_pursuit": ("basis_pursuit", {}),
    "basis_pursuit, tolerance: 0": ("basis_pursuit", {"tolerance": 0.0}),
    "basis_pursuit_lp": ("basis_pursuit_lp", {}),
    "basis_pursuit_lp, tolerance: 0": ("basis_pursuit_lp", {"tolerance": 0.0}),
    "lasso_lars": ("lasso_lars", {}),
    "lasso_lars, penalty: 0.01": ("lasso_lars", {"penalty": 0.01}),
}
IN_SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "greedy_gauss_newton, candidates: all": (
        "greedy_gauss_newton", {"candidates": "all"}),
}
"""Variants that differ where there are more rows than columns."""


@dataclass
class Score:
    """One solver on several problems of one kind."""

    found: int = 0
    share: list[float] = field(default_factory=list)
    error: list[float] = field(default_factory=list)
    residual: list[float] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def add(self, solver: SparseSolver, problem: LeastSquares) -> None:
        begun = time.perf_counter()
        outcome = solver.solve(problem, empty_start(problem.answer.size))
        self.ms.append(1e3 * (time.perf_counter() - begun))
        truth = problem.support
        self.found += bool(np.array_equal(outcome.support, truth))
        self.share.append(float((outcome.support & truth).sum() / truth.sum()))
        size = float(np.linalg.norm(problem.answer))
        self.error.append(float(np.linalg.norm(outcome.c - problem.answer)) / size)
        size = float(np.linalg.norm(problem.A @ problem.answer))
        self.residual.append(outcome.residual_norm / size)
        if outcome.status is not Status.DONE:
            self.failures.append(outcome.status.value)

    def row(self) -> dict[str, Any]:
        return {
            "found": self.found, "of": len(self.share),
            "atoms_found": float(np.mean(self.share)), "error": float(np.median(self.error)),
            "residual": float(np.median(self.residual)), "ms": float(np.median(self.ms)),
            "not_done": ", ".join(sorted(set(self.failures))) or None}


def solvers() -> dict[str, SparseSolver]:
    registry = Registry()
    made: dict[str, Any] = {}
    for name, (plugin, options) in SOLVERS.items():
        try:
            made[name] = registry.get("sparse_solver", plugin)(**options)
        except InputError as error:
            report.progress(f"{name}: {error}")
    return made


def fill(out: report.Report, given: argparse.Namespace) -> None:
    if given.packaged or given.constants or given.screening:
        (recovered_scenes if given.packaged else
         row_constants if given.constants else screening).fill(out, given)
        return
    m, k = given.size
    out.settings |= {
        "problems": f"{m} rows, {k} columns, active columns known in number, empty start, no noise",
        "seeds": f"{min(given.seeds)} to {max(given.seeds)}",
        "found": "problems whose support was found exactly",
        "atoms found": "mean share of the true columns that are in the support",
        "error, residual": "relative to the answer and the right-hand side; medians"}
    everyone = solvers()
    for active in given.active:
        for coherence in given.coherence:
            _table(out, everyone, given, active, coherence)
    scene(out, given)


def scene(out: report.Report, given: argparse.Namespace) -> None:
    """The problems of real steps: more rows than columns, elastic columns nearly dependent."""
    rows, (elastic, thermal) = (120, 40), given.atoms
    case = common.Case.of(common.scene_at(320, given.end))
    table = out.table(
        f"double_pendulum, 2 x 320 triangles, {given.end:g} s: {elastic}/{thermal} atoms active",
        ms=".1f", iterations=".1f", active_elastic=".1f", active_thermal=".1f")
    for name, (plugin, options) in (SOLVERS | IN_SCENES).items():
        if options.get("tolerance") == 0.0:
            continue  # equations: refused where there are more rows than columns
        for seed in given.rows_seeds:
            run = case.run(common.sparse(
                rows, (None, None), active=given.atoms, selection="joint", hysteresis=0.0,
                solver={"use": plugin, **options}), seed)
            if isinstance(run, common.Trajectory):
                table.add(solver=name, seed=seed, **case.errors(run), atoms=run.atoms_text,
                          **_active(run), changes=run.support_changes, iterations=run.iterations,
                          ms=run.ms,
                          status="done" if run.failure is None else common.in_words(run.failure))
            else:
                table.add(solver=name, seed=seed, status=common.in_words(run))
            report.progress(f"{table.rows[-1]}")


def _active(run: common.Trajectory) -> dict[str, float]:
    """Mean number of active atoms, of the link that has more; all where nothing is chosen."""
    used = {**run.atoms, **run.active}
    return {f"active_{field}": max(float(v) for n, v in used.items() if n.endswith(field))
            for field in ("elastic", "thermal")}


def _table(
    out: report.Report, everyone: dict[str, SparseSolver], given: argparse.Namespace,
    active: int, coherence: float,
) -> None:
    scores = {name: Score() for name in everyone}
    cosines = []
    for seed in given.seeds:
        problem = chained(np.random.default_rng(seed), *given.size, active, coherence)
        cosines.append(largest_cosine(problem))
        for name, solver in everyone.items():
            scores[name].add(solver, problem)
        report.progress(f"{active} active, coherence {cosines[-1]:.3f}, seed {seed}")
    table = out.table(f"{active} active, mutual coherence {np.median(cosines):.2f}",
                      atoms_found=".2f", error=".1e", residual=".1e", ms=".0f")
    for name, score in scores.items():
        table.add(solver=name, **score.row())


def largest_cosine(problem: LeastSquares) -> float:
    unit = problem.A / np.linalg.norm(problem.A, axis=0)
    return float(np.abs(unit.T @ unit - np.eye(unit.shape[1])).max())


def arguments(given: Sequence[str] | None = None) -> argparse.Namespace:
    parser = report.options("recovery", __doc__)
    parser.add_argument("--size", type=int, nargs=2, default=[200, 800], metavar=("M", "K"),
                        help="rows and columns")
    parser.add_argument("--active", type=int, nargs="+", default=[40, 20], help="active columns")
    parser.add_argument("--coherence", type=float, nargs="+", default=[0.0, 0.9, 0.97, 0.99],
                        help="cosine of neighbouring columns; 0: independent")
    parser.add_argument("--seeds", type=int, nargs="+",
                        help="1 to 10, of --packaged 1 to 30, of --constants 1 to 5")
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--packaged", action="store_true")
    kind.add_argument("--constants", action="store_true")
    kind.add_argument("--screening", action="store_true")
    parser.add_argument("--scene", nargs="+", choices=[*recovered_scenes.LIMITS],
                        default=[*recovered_scenes.LIMITS], help="of whole scenes")
    parser.add_argument("--atoms", type=int, nargs=2, default=[8, 5], metavar="N",
                        help="elastic and thermal atoms active in the pendulum")
    parser.add_argument("--end", type=float, default=0.1, help="of the pendulum's run, s")
    parser.add_argument("--rows-seeds", type=int, nargs="+", default=[1, 2, 3],
                        help="of its sampled rows")
    found = parser.parse_args(given)
    count = 30 if found.packaged else 5 if found.constants else 10
    found.seeds = found.seeds or list(range(1, count + 1))
    if found.quick:
        found.size, found.active, found.seeds = [40, 80], [4], [1, 2]
        found.scene = ["double_pendulum"]
        found.coherence, found.end, found.rows_seeds = [0.0, 0.97], 0.02, [1]
    found.atoms = (found.atoms[0], found.atoms[1])
    return found


if __name__ == "__main__":
    sys.exit(report.run_plan("recovery", fill, arguments()))
