"""Greedy Gauss-Newton solver of the sparse problem of a time step (Liang et al. 2026, Eq. 25)."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from pydantic import Field

from sparsemor.core import BoolArray, Group, Status
from sparsemor.plugins.sparse_solvers.iterates import always_active
from sparsemor.plugins.sparse_solvers.least_squares_on_support import (
    Fit,
    Linearised,
    fit,
    independent,
    pruned,
    widened,
)
from sparsemor.plugins.sparse_solvers.newton import Choose, SupportNewton
from sparsemor.plugins.sparse_solvers.screen import ExchangeScreen, Rule


class GreedyGaussNewton(SupportNewton):
    """Greedy Gauss-Newton: every iteration may exchange atoms, as in subspace pursuit.

    1 linearise; 2 least squares on the active columns; 3 join them with the columns of each group
    that correlate most with the residual, and solve again; 4 keep the `budget` largest of each
    group and solve on those; 5 accept the exchange if it lowers the linearised residual. It ends
    when neither the support nor the coefficients change: with fewer atoms than rows the residual
    itself does not vanish. Steps 3-4 after Dai and Milenkovic 2009, doi 10.1109/TIT.2009.2016006.
    """

    max_iterations: int = Field(default=30, ge=1)
    """Largest number of linearisations; then the solve ends as not converged."""
    growth: int | None = Field(default=None, ge=1)
    """Largest number of atoms that may enter a group in one iteration; left out: the budget of the
    group."""
    candidates: Literal["correlated", "all"] = "all"
    """Candidate atoms: `all` while there are rows for all of them, or `correlated`: those that
    correlate most with the residual, as published (Liang et al. 2026, Eq. 25). Where active columns
    are nearly parallel to a missing one, the residual does not correlate with it, and only `all`
    finds it."""
    gain: float = Field(default=1e-8, ge=0.0, lt=1.0)
    """Fraction by which an exchange must lower the linearised residual norm: prevents
    endless exchanges of atoms that fit round-off."""
    hysteresis: float = Field(default=0.3, ge=0.0, lt=1.0)
    """Fraction by which an exchange must lower the norm to replace a nonempty warm-started support.
    Each exchange is a jump in velocities that takes some steps to decay. 0: `gain` alone."""

    def screen(self, groups: Sequence[Group], seen: BoolArray, rows: int) -> ExchangeScreen:
        """Fast test of steps 2 to 5 where the residual is linear
        (`core.protocols.sparse_solver`)."""
        everyone = self.candidates == "all" and len(seen) <= rows
        rule = Rule(everyone, self.growth, self.gain, max(self.gain, self.hysteresis),
                    self.max_iterations)
        return ExchangeScreen(rule, groups, seen, rows)

    def chooser(self, groups: Sequence[Group], support: BoolArray) -> Choose:
        first = support if _used(support, groups) else None

        def choose(linear: Linearised, support: BoolArray, explore: bool) -> Fit | Status:
            stays = first is not None and np.array_equal(support, first)
            gain = max(self.gain, self.hysteresis) if stays else self.gain
            found = self._step(linear, support & _visible(linear, groups), groups, explore, gain)
            return found or Status.RANK_DEFICIENT

        return choose

    def _step(
        self, linear: Linearised, support: BoolArray, groups: Sequence[Group], explore: bool,
        gain: float,
    ) -> Fit | None:
        """Least-squares fit after steps 2 to 5 on one linearisation; None when the active columns
        are dependent."""
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
    """True if each group with a budget has an active column."""
    return all(support[g.start : g.stop].any() for g in groups if g.budget)


def _visible(linear: Linearised, groups: Sequence[Group]) -> BoolArray:
    """Mask (k,), False for penalised columns of zeros, which cannot be active."""
    return (linear.norms > 0.0) | always_active(groups, linear.norms.size)
