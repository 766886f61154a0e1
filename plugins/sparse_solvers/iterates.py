"""Common parts of iterations over supports: initial iterate, stopping test, outcome, cycles."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sparsemor.core import (
    BoolArray,
    FloatArray,
    Group,
    SparseOutcome,
    SparseProblem,
    SparseStart,
    Status,
)
from sparsemor.plugins.sparse_solvers.least_squares_on_support import EPS, Fit, Linearised, pruned


def always_active(groups: Sequence[Group], size: int) -> BoolArray:
    """Mask (k,), True in the groups without a budget, whose columns are always active."""
    always = np.zeros(size, dtype=np.bool_)
    for g in groups:
        if g.budget is None:
            always[g.start : g.stop] = True
    return always


def within_budget(problem: SparseProblem, start: SparseStart) -> tuple[FloatArray, BoolArray]:
    """Initial coefficients and support, zero outside the support and with no more active columns
    than the budgets allow."""
    groups = problem.groups
    support = start.support | always_active(groups, start.c.size)
    c = np.where(support, start.c, 0.0)
    if any(g.budget is not None and support[g.start : g.stop].sum() > g.budget for g in groups):
        norms = np.linalg.norm(problem.jacobian(c), axis=0)
        support = pruned(norms * c, support, groups)
        c = np.where(support, c, 0.0)
    return c, support


def small_step(linear: Linearised, found: Fit, groups: Sequence[Group], rtol: float) -> bool:
    """True if the step of every group is within `rtol` of the group's norm, or within rounding
    errors."""
    step = found.z - linear.z
    floor = min(4.0 * EPS / found.rcond, rtol) * float(np.linalg.norm(found.z))
    return all(
        float(np.linalg.norm(step[g.start : g.stop]))
        <= max(rtol * float(np.linalg.norm(found.z[g.start : g.stop])), floor)
        for g in groups
    )


def ended(
    problem: SparseProblem, c: FloatArray, good: SparseOutcome, status: Status, iterations: int
) -> SparseOutcome:
    """Outcome at the coefficients c with their residual norm; if that overflowed, `good` with
    status NOT_FINITE."""
    norm = float(np.linalg.norm(problem.residual(c)))
    if not np.isfinite(norm):
        return replace(good, status=Status.NOT_FINITE, iterations=iterations)
    return SparseOutcome(c, good.support, status, iterations, norm)


class Visits:
    """Supports visited during one solve, and the best iterate on each."""

    def __init__(self) -> None:
        self._best: dict[bytes, SparseOutcome] = {}
        self._last = b""

    def note(self, iterate: SparseOutcome) -> bool:
        """Records an iterate; True when its support was left before and has returned."""
        key = iterate.support.tobytes()
        cycle = key in self._best and key != self._last
        if key not in self._best or iterate.residual_norm < self._best[key].residual_norm:
            self._best[key] = iterate
        self._last = key
        return cycle

    def best(self) -> SparseOutcome:
        """Recorded iterate of least residual norm."""
        return min(self._best.values(), key=lambda iterate: iterate.residual_norm)
