"""Constants of sampled rows on complete bases, of r and of D^-1 r, and what sparse solvers recover.

Rows: Latin hypercube samples of the packaged `double_pendulum_published`, of its first link. B: the
sampled rows of D A (plain), with UNTF in front, and of A (those of D^-1 D A). Columns have unit
length. delta: largest |s^2 - 1| over singular values s of B on random supports of the size of the
budget, a lower bound of the restricted isometry constant; leading: the same for the first columns;
below 1 all combinations of such a support are told apart. Recovery: the last snapshot from its
sampled forces alone, from an empty support.

Then, with few POD atoms A in each block of the packaged scenes, all of them active or half of them
selected: what the constants of S, the sampled rows of r, of P r (UNTF) and of D^-1 r, say of the
recovery of a state x from S D x, and what happens. bound: norm of (S D A)^+ S D, by which the
part of x outside the atoms can grow; grown: by which it grows, the largest of the snapshots;
ratio: error of half of the atoms, selected from the sampled rows, relative to the best half.
"""

import argparse
import time
from collections.abc import Sequence
from typing import Any

import common
import numpy as np
from modules import report
from modules.recovered_scenes import QUICK, case_of

from sparsemor.core import StepFactors
from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.linalg.column_subsets import ColumnSubsets
from sparsemor.core.linalg.dense import coherence, condition_number, unit_columns
from sparsemor.core.registry.registry import Registry
from sparsemor.core.status import Status
from sparsemor.plugins.bases.pod import Pod
from sparsemor.plugins.preconditioners.untf import UnitNormTightFrame

SOLVERS: dict[str, tuple[str, dict[str, Any]]] = {
    "greedy": ("greedy_gauss_newton", {"candidates": "correlated"}),
    "omp": ("omp", {}),
    "lasso_lars": ("lasso_lars", {}),
    "basis_pursuit_lp": ("basis_pursuit_lp", {"tolerance": 1e-9}),
}
SUPPORTS = 100
"""Random supports of which the worst counts."""
ATOMS, STATES = 16, 40
"""Atoms of a block, and states from which half of them are selected."""


def fill(out: report.Report, given: argparse.Namespace) -> None:
    size = 320 if given.quick else 1280
    scene = common.scene_at(size, 0.06 if given.quick else 4.0, "double_pendulum_published")
    case = common.Case.of(scene)
    h = scene.time.step
    rows_of = {"elastic": (240, 80), "thermal": (80, 20)} if not given.quick else {
        "elastic": (60, 20), "thermal": (40, 10)}
    out.settings |= {"scene": f"link1, {size} triangles, h = {h:g} s, uncentred complete bases",
                     "seeds": f"{min(given.seeds)} to {max(given.seeds)}; the worst counts"}
    table = out.table("Constants of sampled rows", coherence=".2f", condition=".1e",
                          delta_random=".2f", delta_leading=".2f")
    recovery = out.table("Recovery of the last snapshot from an empty support", error=".1e",
                         ms=".0f")
    for field, (m, s) in rows_of.items():
        truth = case.reference[f"link1.{field}"]
        data = case.model.block_data(
            f"link1.{field}", np.asarray(truth).T,
            StepFactors(h, *scene.integrator.rules(h).factors))
        x, A = np.asarray(truth[-1]), Pod(complete=True).build(data).atoms
        DA, load = np.asarray(data.operator @ A), np.asarray(data.operator @ x)
        seen: dict[str, list[dict[str, float]]] = {}
        found: dict[tuple[str, str], list[tuple[float, float, str]]] = {}
        for seed in given.seeds:
            rng = np.random.default_rng(seed)
            rows = np.sort(rng.choice(len(A), m, replace=False))
            kinds = {"r": (DA[rows], load[rows]), "D^-1 r": (A[rows], x[rows])}
            if field == "thermal":
                P = UnitNormTightFrame().build(DA[rows])
                kinds["r, UNTF"] = (P @ DA[rows], P @ load[rows])
            for kind, (B, b) in kinds.items():
                seen.setdefault(kind, []).append(constants_of(B, s, rng))
                for name in SOLVERS:
                    found.setdefault((kind, name), []).append(recovered(name, B, b, s, A, x))
        for kind, each in seen.items():
            table.add(field=field, rows=kind, m=m, k=A.shape[1], s=s,
                          **{key: max(one[key] for one in each) for key in each[0]})
        for (kind, name), runs in found.items():
            recovery.add(field=field, rows=kind, solver=name, error=max(e for e, _, _ in runs),
                         ms=max(ms for _, ms, _ in runs),
                         status=", ".join(sorted({status for _, _, status in runs})))
        report.progress(field)
    few_atoms(out, given)


def few_atoms(out: report.Report, given: argparse.Namespace) -> None:
    table = out.table(f"{ATOMS} POD atoms, {2 * ATOMS} rows by Latin hypercube or all", sigma=".1e",
                      coherence=".2f", delta=".2f", bound=".1e", grown=".1e", ratio=".1e")
    for scene in given.scene:
        case = case_of(scene, QUICK if given.quick else {})
        h = case.scene.time.step
        for name in case.model.reducible():
            x = np.asarray(case.reference[name]).T
            step = StepFactors(h, *case.scene.integrator.rules(h).factors)
            data = case.model.block_data(name, x, step)
            if np.ptp(x) <= 1e-12 * np.abs(x).max():
                continue
            A = Pod(count=ATOMS).build(data).atoms
            for kind, of in _kinds(data.operator, A, given.seeds).items():
                found = [_amplified(S, SD, A, x) for S, SD in of]
                table.add(scene=scene, block=name, rows=kind, m=len(of[0][0]), **{
                    key: (min if key == "sigma" else max)(one[key] for one in found)
                    for key in found[0]})
        report.progress(scene)


def _kinds(
    D: Csr, A: FloatArray, seeds: Sequence[int]
) -> dict[str, list[tuple[FloatArray, FloatArray]]]:
    """Of each kind of rows S and seed: B = S D A (m, k) and S D (m, n)."""
    found: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
    DA, n = np.asarray(D @ A), len(A)
    for seed in seeds:
        rows = np.sort(np.random.default_rng(seed).choice(n, min(2 * A.shape[1], n), replace=False))
        SD = D[rows].toarray()
        Q, R = np.linalg.qr(DA[rows])  # UNTF is undefined for more rows than atoms
        P = UnitNormTightFrame().build(R) @ Q.T
        one = np.zeros((len(rows), n))
        one[np.arange(len(rows)), rows] = 1.0
        for kind, part in (("r", (DA[rows], SD)), ("r, UNTF", (P @ DA[rows], P @ SD)),
                           ("D^-1 r", (A[rows], one))):
            found.setdefault(kind, []).append(part)
    found["D^-1 r, all"] = [(A.T @ A, A.T)]
    return found


def _amplified(B: FloatArray, SD: FloatArray, A: FloatArray, x: FloatArray) -> dict[str, float]:
    U, half, lengths = unit_columns(B), B.shape[1] // 2, np.linalg.norm(B, axis=0)
    inverse = np.linalg.pinv(U, rcond=1e-13) / lengths[:, None]
    c = A.T @ x
    rest = x - A @ c
    left = np.linalg.norm(rest, axis=0)
    seen = left > 1e-10 * np.linalg.norm(x, axis=0).max()
    error = np.linalg.norm(rest - A @ (inverse @ (SD @ rest)), axis=0)
    best = chosen = 0.0
    for i in np.linspace(0, x.shape[1] - 1, STATES).astype(np.int64):
        order = np.argsort(-np.abs(c[:, i]))
        best = max(best, float(np.hypot(np.linalg.norm(c[order[half:], i]), left[i])))
        solver = Registry().get("sparse_solver", "omp")()
        picked = solver.prepare(ColumnSubsets(np.ascontiguousarray(U), 1e-12), half).select(
            -(SD @ x[:, i]), np.zeros(len(c)), np.zeros(len(c), dtype=np.bool_)).support
        own = np.linalg.lstsq(B[:, picked], SD @ x[:, i], rcond=None)[0]
        chosen = max(chosen, float(np.linalg.norm(A[:, picked] @ own - x[:, i])))
    return {"sigma": float(np.linalg.svd(U, compute_uv=False)[-1]), "coherence": coherence(B),
            "delta": delta(U[:, :half]), "bound": float(np.linalg.norm(inverse @ SD, 2)),
            "grown": float((error[seen] / left[seen]).max(initial=1.0)), "ratio": chosen / best}


def constants_of(B: FloatArray, s: int, rng: np.random.Generator) -> dict[str, float]:
    U, k = unit_columns(B), B.shape[1]
    some = [rng.choice(k, s, replace=False) for _ in range(SUPPORTS)]
    return {"coherence": coherence(B), "condition": condition_number(U),
            "delta_random": max(delta(U[:, at]) for at in some), "delta_leading": delta(U[:, :s])}


def delta(J: FloatArray) -> float:
    return float(np.abs(np.linalg.svd(J, compute_uv=False) ** 2 - 1.0).max())


def recovered(
    name: str, B: FloatArray, b: FloatArray, s: int, A: FloatArray, x: FloatArray
) -> tuple[float, float, str]:
    """Error of the state that a solver recovers from B c = b, relative to x, CPU ms, status."""
    plugin, options = SOLVERS[name]
    solver = Registry().get("sparse_solver", plugin)(**options)
    lengths = np.linalg.norm(B, axis=0)
    columns = ColumnSubsets(np.ascontiguousarray(B / lengths), 1e-12)
    begun = time.process_time()
    none = np.zeros(B.shape[1], dtype=np.bool_)
    chosen = solver.prepare(columns, s).select(-b, np.zeros(B.shape[1]), none)
    ms = 1e3 * (time.process_time() - begun)
    if chosen.status is not Status.DONE:
        return float("nan"), ms, chosen.status.value
    c = columns.least_norm_solution(chosen.support, b) / lengths
    return float(np.linalg.norm(A @ c - x) / np.linalg.norm(x)), ms, "done"
