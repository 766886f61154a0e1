"""Where each linear solver stops paying: heat and elasticity of the disk, three meshes.

    python tests/benchmarks/linear_solvers.py [--quick] [--out linear_solvers.json]

Every solver makes the matrix of a step ready and solves with it in a process of its own, so that
what it holds at its largest is its own. Seconds are CPU time of one thread. A warm start is the
solution, off by 1e-4 of its size: about what the extrapolation of past steps gives.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import common  # noqa: F401  one thread, before NumPy is loaded
import numpy as np
from modules import report
from scipy import sparse

from sparsemor.bodies.fem import elasticity, integrals
from sparsemor.bodies.material import Isotropic
from sparsemor.bodies.mesh.generators.disk import Disk
from sparsemor.core import DofLocations
from sparsemor.core.registry.registry import Registry
from sparsemor.core.simulation.memory.limits import peak, resident
from sparsemor.plugins.linear_solvers.auto import AutomaticSolver

STEEL = Isotropic(E=200e9, nu=0.3, rho=7850, alpha=12.3e-6, k=44.5, c=475)
STEP = 1e-3
NEEDS = {"splu": "scipy", "cholmod": "sksparse", "pardiso": "pypardiso", "cg": "scipy",
         "amg": "pyamg"}
OFF = 1e-4
"""Relative size of what a warm start misses."""


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "matrices": "disk of the brake scene, h = 1 ms; heat: c1 C + K; elasticity: K + c2 M, its "
                    "hub held",
        "right-hand sides": f"random, {given.repeats} a case, medians; iterative ones to 1e-10",
        "memory": "factors: what the solver says it holds; peak: what its process came to hold "
                  "besides the matrix, MB",
        "not installed": ", ".join(n for n, p in NEEDS.items() if not find_spec(p)) or "none"}
    table = out.table("Factorization s / solve ms")
    best = out.table("Quickest over a run of so many solves")
    with tempfile.TemporaryDirectory() as folder:
        for refine in given.refine:
            for field, A, places, tetrahedra in matrices(refine):
                file = Path(folder) / f"{field}.npz"
                _save(file, A, places)
                rows = []
                for solver in (n for n, package in NEEDS.items() if find_spec(package)):
                    row = _apart(file, solver, given)
                    rows.append(row)
                    table.add(tetrahedra=tetrahedra, field=field, unknowns=A.shape[0], **row)
                    report.progress(f"refine {refine:g}, {field}, {solver}: {row}")
                chosen = AutomaticSolver().choose(A, places)[1]
                table.add(tetrahedra=tetrahedra, field=field, unknowns=A.shape[0], solver="auto",
                          status=f"takes {chosen}")
                best.add(tetrahedra=tetrahedra, field=field, unknowns=A.shape[0], **{
                    f"{steps}": _quickest(rows, steps) for steps in (1, 100, 1200, 10_000)})


def matrices(refine: float) -> Any:
    """(field, matrix, places, tetrahedra)."""
    mesh = Disk(refine=refine).build(Path())
    n = len(mesh.points)
    A = integrals.capacity(mesh, STEEL.rho, STEEL.c) / STEP + integrals.conductivity(mesh, STEEL.k)
    yield "T", A.tocsr(), DofLocations(mesh.points, np.zeros(n, np.int64)), len(mesh.cells)
    held = mesh.point_sets["hub"]
    free = np.setdiff1d(np.arange(3 * n), (3 * held[:, None] + np.arange(3)).ravel())
    M = sparse.kron(integrals.scalar_mass(mesh, STEEL.rho), sparse.eye_array(3), format="csr")
    D = elasticity.elastic_stiffness(mesh, STEEL, 1.0, "solid") + M / STEP**2
    D = D.tocsr()[free][:, free]
    yield "u", D.tocsr(), DofLocations(mesh.points[free // 3], free % 3), len(mesh.cells)


def _save(file: Path, A: Any, places: DofLocations) -> None:
    np.savez(file, data=A.data, indices=A.indices, indptr=A.indptr,
             coordinates=places.coordinates, component=places.component)


def _apart(file: Path, solver: str, given: argparse.Namespace) -> dict[str, Any]:
    """One row, measured by a process of its own."""
    done = subprocess.run(
        [sys.executable, __file__, "--one", str(file), solver, "--repeats", str(given.repeats)],
        capture_output=True, text=True)
    if done.returncode:
        return {"solver": solver, "status": done.stderr.strip().splitlines()[-1]}
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def measure(file: Path, name: str, repeats: int) -> dict[str, Any]:
    a = np.load(file)
    n = len(a["indptr"]) - 1
    A = sparse.csr_array((a["data"], a["indices"], a["indptr"]), shape=(n, n))
    places = DofLocations(a["coordinates"], a["component"])
    solver: Any = Registry().get("linear_solver", name)()
    small = sparse.csr_array(sparse.eye_array(200) * 2.0)
    solver.factorize(small).solve(np.ones(200))  # libraries are loaded, and counted with the base
    base, begun = resident(), time.process_time()
    factor = solver.factorize(A, places)
    seconds = time.process_time() - begun
    rng, cold, warm = np.random.default_rng(0), [], []
    for _ in range(repeats):
        b = rng.standard_normal(n)
        cold.append(_solve(factor, b, None))
        x = cold[-1][1].x
        start = x + OFF * np.linalg.norm(x) / np.sqrt(n) * rng.standard_normal(n)
        if factor.iterative:
            warm.append(_solve(factor, b, start))
    outcome = cold[-1][1]
    row = {"solver": name, "factor_s": seconds, "solve_ms": _median(cold),
           "factors": factor.memory / 1e6, "peak": max(peak() - base, 0) / 1e6,
           "expected": solver.expected(A, places) / 1e6, "residual": outcome.residual,
           "status": outcome.status.value}
    if warm:
        row |= {"iterations": outcome.iterations, "warm": warm[-1][1].iterations,
                "warm_ms": _median(warm)}
    return row


def _solve(factor: Any, b: Any, start: Any) -> tuple[float, Any]:
    """ms, outcome; direct solvers are timed as a step calls them."""
    begun = time.process_time()
    if not factor.iterative:
        factor.solve(b)
        return 1e3 * (time.process_time() - begun), factor.outcome(b)
    outcome = factor.outcome(b, start)
    return 1e3 * (time.process_time() - begun), outcome


def _median(timed: list[tuple[float, Any]]) -> float:
    return float(np.median([ms for ms, _ in timed]))


def _quickest(rows: list[dict[str, Any]], steps: int) -> str:
    cost = {r["solver"]: r["factor_s"] + 1e-3 * steps * r.get("warm_ms", r["solve_ms"])
            for r in rows if r["status"] == "done"}
    if not cost:
        return "-"
    name = min(cost, key=lambda n: cost[n])
    return f"{name} {cost[name]:.3g} s"


def arguments() -> argparse.Namespace:
    parser = report.options("linear_solvers", __doc__)
    parser.add_argument("--refine", type=float, nargs="+", default=[1.0, 2.0, 3.0])
    parser.add_argument("--repeats", type=int, default=3, help="right-hand sides")
    parser.add_argument("--one", nargs=2, metavar=("FILE", "SOLVER"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.quick:
        given.refine, given.repeats = [0.4], 1
    return given


if __name__ == "__main__":
    asked = arguments()
    if asked.one:
        print(json.dumps(measure(Path(asked.one[0]), asked.one[1], asked.repeats)))
    else:
        sys.exit(report.run_plan("linear_solvers", fill, asked))
