"""Greedy Gauss-Newton for the sparse step problem (Eq. 25)."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from sparsemor.core import (
    BoolArray,
    FloatArray,
    Group,
    Plugin,
    SparseOutcome,
    SparseProblem,
    SparseStart,
    Status,
)
from sparsemor.plugins.sparse_solvers.iterates import (
    always_active,
    ended,
    small_step,
    within_budget,
)
from sparsemor.plugins.sparse_solvers.least_squares_on_support import (
    Fit,
    Linearised,
    fit,
    independent,
    pruned,
    widened,
)
from sparsemor.plugins.sparse_solvers.screen import ExchangeScreen, Rule
from sparsemor.plugins.sparse_solvers.support_cycles import Visits


class GreedyGaussNewton(Plugin):
    """Greedy Gauss-Newton: every iteration may exchange atoms, as in subspace pursuit.

    1 linearise; 2 least squares on the active columns; 3 join them with the columns of each
    group that correlate most with what is left, and solve again; 4 keep the `budget` largest of
    each group and solve on those; 5 take the exchange if it lowers the linearised residual.
    It ends when neither the support nor c changes: with fewer atoms than rows the residual
    itself does not vanish. Steps 3-4 after Dai and Milenkovic 2009, doi 10.1109/TIT.2009.2016006.
    """

    rtol: float = Field(default=1e-8, gt=0.0, lt=1.0)
    """Largest step of each group, relative to the group (both scaled by column norms), that
    ends the iteration."""
    max_iterations: int = Field(default=30, ge=1)
    """Linearisations before the solve is given up as not converged."""
    growth: int | None = Field(default=None, ge=1)
    """Most atoms that may enter a group in one iteration; left out: as many as its budget."""
    candidates: Literal["correlated", "all"] = "all"
    """Which atoms may enter: all of them while there are rows for all, or those that correlate most
    with what is left, as published (Eq. 25). Where active columns are so alike that together they
    imitate a missing one, nothing is left that correlates with it, and only `all` finds it."""
    gain: float = Field(default=1e-8, ge=0.0, lt=1.0)
    """Fraction by which an exchange must lower the linearised residual norm: keeps atoms that
    fit round-off from changing places for ever."""
    hysteresis: float = Field(default=0.3, ge=0.0, lt=1.0)
    """The same for an exchange that leaves the support which the solve was given, when that is not
    empty. A carried support that is about as good as another is kept: each exchange is a jump in
    velocities that takes steps to die out. 0: `gain` alone."""
    rank_rtol: float = Field(default=1e-12, gt=0.0, lt=1.0)
    """Reciprocal condition number at which active columns count as dependent."""

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome:
        """c (k,) and its support. A failure returns the last iterate that was finite."""
        with np.errstate(all="ignore"):  # overflow is a status here, not a warning
            c, support = within_budget(problem, start)
            return self._iterate(problem, c, support)

    def screen(self, groups: Sequence[Group], seen: BoolArray, rows: int) -> ExchangeScreen:
        """Steps 2 to 5 where the residual is linear (`core.protocols.sparse_solver`)."""
        everyone = self.candidates == "all" and len(seen) <= rows
        rule = Rule(everyone, self.growth, self.gain, max(self.gain, self.hysteresis),
                    self.max_iterations)
        return ExchangeScreen(rule, groups, seen, rows)

    def _iterate(self, problem: SparseProblem, c: FloatArray, support: BoolArray) -> SparseOutcome:
        groups, visits, explore = problem.groups, Visits(), True
        given = support if _used(support, groups) else None
        good = SparseOutcome(c, support, Status.NOT_FINITE, 0, float("inf"))
        for iteration in range(1, self.max_iterations + 1):
            r = problem.residual(c)
            linear = Linearised.at(c, r, problem.jacobian(c))
            if not linear.finite:
                return replace(good, status=Status.NOT_FINITE, iterations=iteration)
            good = SparseOutcome(c, support, Status.DONE, iteration, float(np.linalg.norm(r)))
            if explore and visits.note(good):
                # a cycle: from here on plain Gauss-Newton on the best support in it
                explore, good = False, visits.best()
                c, support = good.c, good.support
                continue
            stays = given is not None and np.array_equal(support, given)
            found = self._step(linear, support & _visible(linear, groups), groups, explore,
                               max(self.gain, self.hysteresis) if stays else self.gain)
            if found is None:
                return replace(good, status=Status.RANK_DEFICIENT, iterations=iteration)
            settled = np.array_equal(found.active, support) and small_step(
                linear, found, groups, self.rtol)
            c, support = linear.unscaled(found.z), found.active
            if settled:
                return ended(problem, c, good, Status.DONE, iteration)
        last = replace(good, support=support)
        last = ended(problem, c, last, Status.NOT_CONVERGED, self.max_iterations)
        if last.status is Status.NOT_FINITE:
            return last
        visits.note(last)
        return replace(visits.best(), status=last.status, iterations=last.iterations)

    def _step(
        self, linear: Linearised, support: BoolArray, groups: Sequence[Group], explore: bool,
        gain: float,
    ) -> Fit | None:
        """Steps 2 to 5 on one linearisation; None when the active columns are dependent."""
        base = fit(linear, support, self.rank_rtol)
        if base is None or not explore or base.norm <= base.round_off:
            return base
        if self.candidates == "all" and linear.J.shape[1] <= linear.J.shape[0]:
            union = linear.norms > 0.0
        else:
            union = widened(linear, base, groups, self.growth)
        if np.array_equal(union, support):
            return base
        wide = fit(linear, union, self.rank_rtol)
        if wide is None:
            union = independent(linear, support, union, self.rank_rtol)
            wide = fit(linear, union, self.rank_rtol)
        if wide is None:
            return base
        kept = pruned(wide.z, union, groups)
        new = fit(linear, kept, self.rank_rtol)
        least = base.norm - max(gain * base.norm, base.round_off)
        return base if new is None or new.norm >= least else new


def _used(support: BoolArray, groups: Sequence[Group]) -> bool:
    """Is something active in each group with a budget?"""
    return all(support[g.start : g.stop].any() for g in groups if g.budget)


def _visible(linear: Linearised, groups: Sequence[Group]) -> BoolArray:
    """False for penalised columns of zeros: no row sees them, so they cannot be active."""
    return (linear.norms > 0.0) | always_active(groups, linear.norms.size)
