"""Greedy Gauss-Newton solver of the sparse problem of a time step (Liang et al. 2026, Eq. 25)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from sparsemor.core import BoolArray, Columns, FloatArray, Group, Recovery, Selection, Status
from sparsemor.core.linalg.column_subsets import is_unit_matrix, pseudo_inverse
from sparsemor.plugins.sparse_solvers.gram_exchange import GramExchange
from sparsemor.plugins.sparse_solvers.newton_on_supports import Choose, SupportNewton
from sparsemor.plugins.sparse_solvers.penalised import repeated
from sparsemor.plugins.sparse_solvers.supports import (
    EPS,
    Fit,
    Linearised,
    always_active,
    fit,
    independent,
    largest,
    pruned,
    widened,
)

SINGULAR = 1e-10
"""Singular value, relative to the largest, below which a combination of unit columns is zero."""


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

    def prepare(self, columns: Columns, budget: int) -> Recovery:
        """Steps 2 to 5 (exchanges of columns) for constant columns J (m, k), of unit length or
        zero; one parallel to an earlier column counts as zero. With candidates `all`, and rows for
        all columns, their pseudo-inverse gives step 3, else the Gram matrix J^T J serves."""
        J, (m, k) = np.array(columns.A), columns.A.shape
        if is_unit_matrix(J):
            return GreedyRecovery(self, columns, np.ones(k), (Group("", 0, k, budget),), None, None)
        J[:, repeated(J)] = 0.0
        everyone = self.candidates == "all" and k <= m
        return GreedyRecovery(
            self, columns, np.sqrt(np.einsum("ij,ij->j", J, J)), (Group("", 0, k, budget),),
            pseudo_inverse(J, SINGULAR) if everyone else None,
            None if everyone else GramExchange.from_matrix(J))

    def chooser(self, groups: Sequence[Group], support: BoolArray) -> Choose:
        def choose(linear: Linearised, support: BoolArray, explore: bool) -> Fit | Status:
            found = self.step(linear, support & _visible(linear, groups), groups, explore)
            return found or Status.RANK_DEFICIENT

        return choose

    def step(
        self, linear: Linearised, support: BoolArray, groups: Sequence[Group], explore: bool
    ) -> Fit | None:
        """Least-squares fit after steps 2 to 5 on one linearisation; None when the active columns
        are dependent.

        2 `base`: fit on the support; 3 `wide`: fit on its union with the candidates; 4 `new`: fit
        on the largest coefficients of `wide` within the budgets; 5 `new` if its residual norm is
        lower by the share `gain`, else `base`. explore: False keeps the support.
        """
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
            union = independent(linear.J, support, union, self.rank_rtol)
            wide = fit(linear, union, self.rank_rtol)
        if wide is None:
            return base
        kept = pruned(wide.z, union, groups)
        new = fit(linear, kept, self.rank_rtol)
        least = base.norm - max(self.gain * base.norm, base.round_off)
        return base if new is None or new.norm >= least else new


@dataclass(frozen=True, slots=True, eq=False)
class GreedyRecovery:
    """Greedy exchange of columns for a linear problem with a constant matrix J (m, k).

    lengths (k,): column lengths, 1 or 0; inverse (k, m): pseudo-inverse of J, with which one
    product gives least squares on all columns; None where only correlated columns are candidates;
    gram: the Gram matrix with which these are exchanged. Both None: J is the unit matrix.
    """

    solver: GreedyGaussNewton
    columns: Columns
    lengths: FloatArray
    groups: tuple[Group, ...]
    inverse: FloatArray | None
    gram: GramExchange | None

    def select(self, r: FloatArray, c: FloatArray, support: BoolArray) -> Selection:
        """Support after the exchanges of steps 2 to 5."""
        if not float(r.dot(r) + c.dot(c)) < np.inf:
            return Selection(support, Status.NOT_FINITE)
        if self.inverse is not None:
            return self._among_all(r, c, support, self.inverse)
        if self.gram is None:  # least squares on all columns are -r, as correlations are
            return Selection(largest(np.abs(c - r), self.groups[0].budget or 0))
        now = pruned(c, support & (self.lengths > 0.0), self.groups)
        found = self.by_gram(r, c, support) if (now == support).all() else None
        return found or self.by_qr(r, c, support, now)

    def by_gram(self, r: FloatArray, c: FloatArray, support: BoolArray) -> Selection | None:
        """Support after exchanges by normal equations, from the least-squares solution c (k,) on
        `support` with the residual r (m,), r + J d for a change d of c; None where columns are too
        alike for these. Each exchange adds the columns that correlate most with the residual and
        keeps the `budget` largest coefficients, while that lowers the residual norm."""
        gram, budget, now, z = self.gram, self.groups[0].budget or 0, support, c
        assert gram is not None
        norm = math.sqrt(r.dot(r))
        for _ in range(self.solver.max_iterations):
            round_off = 100.0 * EPS * math.sqrt(z.dot(z))
            if norm <= round_off:
                return Selection(now)
            g = gram.correlations(r)
            size = np.where(now, 0.0, np.abs(g))
            room = len(r) - int(np.count_nonzero(now))  # none where rows are as many as atoms
            union = now | largest(size, min(budget, self.solver.growth or budget, room))
            found = gram.exchanged(r, z, g, now, union, budget)
            if found is None:
                return None
            after = math.sqrt(found.r.dot(found.r))
            if after >= norm - max(self.solver.gain * norm, round_off):
                return Selection(now)
            now, z, r, norm = found.active, found.z, found.r, after
        return Selection(support, Status.NOT_CONVERGED)

    def by_qr(
        self, r: FloatArray, c: FloatArray, support: BoolArray, now: BoolArray
    ) -> Selection:
        """Support after exchanges by QR factorizations that start from `now`, the part of `support`
        within the budget; r (m,): residual at the coefficients c (k,)."""
        linear = Linearised(self.columns.A, r, c, self.lengths)
        for _ in range(self.solver.max_iterations):
            found = self.solver.step(linear, now, self.groups, True)
            if found is None:
                return Selection(support, Status.RANK_DEFICIENT)
            if np.array_equal(found.active, now):
                return Selection(now)
            now = found.active
        return Selection(support, Status.NOT_CONVERGED)

    def _among_all(
        self, r: FloatArray, c: FloatArray, support: BoolArray, inverse: FloatArray
    ) -> Selection:
        """Support of the largest coefficients of least squares on all columns, which do not depend
        on the support: one exchange is all, and the caller compares its residual norm. inverse
        (k, m): pseudo-inverse of J, so that z = c - inverse r minimises |r + J (z - c)|."""
        z, columns = c - inverse.dot(r), self.columns
        kept = largest(np.abs(z), self.groups[0].budget or 0)
        if (kept == support).all():
            return Selection(support)
        if not columns.independent(kept):
            kept = independent(columns.A, support & kept, kept, self.solver.rank_rtol)
        return Selection(kept)


def _visible(linear: Linearised, groups: Sequence[Group]) -> BoolArray:
    """Mask (k,), False for penalised columns of zeros, which cannot be active."""
    return (linear.norms > 0.0) | always_active(groups, linear.norms.size)
