"""Share of the columns of a recovered scene that a safe rule of the lasso excludes at the start of
a step.

The lasso of a block's sampled rows is min |b - J z|^2 / 2 + lambda |z|_1, with unit columns J and
b = x(t) in the sampled rows. Gap safe sphere (Ndiaye, Fercoq, Gramfort and Salmon 2017, J. Mach.
Learn. Res. 18, 1): with a feasible dual point theta and the duality gap G of z, column j is zero in
the solution if |J_j^T theta| + sqrt(2 G) / lambda < 1. Start: z and theta of the previous step's
solution, exact (by LARS), the best that a step can begin with: there sqrt(2 G) = |b - b_previous|.
"""

import argparse
from collections.abc import Iterator

import numpy as np
from modules import report
from modules.recovered_scenes import QUICK, case_of

from sparsemor.core.arrays import FloatArray

PENALTIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
"""lambda relative to the least one with which the solution is zero."""
STEPS = 5
"""Steps of the run, evenly spread."""


def fill(out: report.Report, given: argparse.Namespace) -> None:
    out.settings |= {
        "start": f"the exact solution of the previous step; median of {STEPS} steps",
        "lambda": "relative to the least one with which the solution is zero",
        "error": "of the lasso in the sampled rows, relative to b, at the same steps"}
    table = out.table("Columns that a gap safe sphere excludes, of 100", excluded=".0f",
                      error=".1e")
    for name in given.scene:
        case = case_of(f"{name}_recovered", QUICK if given.quick else {})
        solver = case.prepared(case.scene.dump()["reducer"], given.seeds[0])
        for block, rows in solver.rows.items():
            d = solver.dictionaries[block]
            A = d.atoms[rows]
            J = A / np.linalg.norm(A, axis=0)
            truth = case.reference[block]
            found: dict[float, list[tuple[float, float]]] = {p: [] for p in PENALTIES}
            for n in np.linspace(1, case.steps, STEPS + 1).astype(int)[1:]:
                before, now = (np.asarray(truth[i])[rows] - d.offset[rows] for i in (n - 1, n))
                for penalty, numbers in screened(J, before, now):
                    found[penalty].append(numbers)
            for penalty, many in found.items():
                share, error = np.median(np.array(many), axis=0)
                table.add(scene=name, block=block, rows=len(rows), columns=J.shape[1],
                          penalty=f"{penalty:g}", excluded=100.0 * float(share),
                          error=float(error))
        report.progress(name)


def screened(
    J: FloatArray, before: FloatArray, now: FloatArray
) -> Iterator[tuple[float, tuple[float, float]]]:
    """Share of columns that are excluded, and the error of the lasso, for each penalty."""
    from sklearn.linear_model import lars_path  # of the extra `lars`

    m = len(before)
    scale = m / float(np.abs(J.T @ before).max())  # LARS stops at an absolute tolerance
    before, now = scale * before, scale * now
    change = float(np.linalg.norm(now - before))
    values, _, path = lars_path(J, before, method="lasso", alpha_min=PENALTIES[-1])
    values = np.asarray(values) * m
    for penalty in PENALTIES:
        level = penalty * m
        # the path is linear in lambda between its corners
        z = np.array([np.interp(level, values[::-1], row[::-1]) for row in path])
        r = before - J @ z
        theta = r / max(level, float(np.abs(J.T @ r).max()))
        share = float(np.mean(np.abs(J.T @ theta) + change / level < 1.0))
        yield penalty, (share, float(np.linalg.norm(r)) / float(np.linalg.norm(before)))
