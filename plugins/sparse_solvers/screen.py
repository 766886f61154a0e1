"""Fast test whether greedy Gauss-Newton exchanges columns, where the residual is linear.

It uses the Gram matrix of the residual's columns. Fits are compared by their difference to the
solution of the time step, so that squared norms keep the digits that decide.
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas

from sparsemor.core import BoolArray, FloatArray, GramError, Group, IntArray, Quadratic, Reason
from sparsemor.plugins.sparse_solvers.candidates import Joining
from sparsemor.plugins.sparse_solvers.factors import Factors, room
from sparsemor.plugins.sparse_solvers.fits import Fits
from sparsemor.plugins.sparse_solvers.hard_thresholding import (
    Largest,
    Sizes,
    Tolerance,
    apart,
    choices,
    first,
    reach,
)
from sparsemor.plugins.sparse_solvers.least_squares_on_support import EPS
from sparsemor.plugins.sparse_solvers.optimality_certificates import (
    OfAll,
    OfJoined,
    Refusal,
    Refusals,
)

TINY, UNKNOWN = 1e-300, GramError(np.inf, np.inf)
FEW_WAYS = 4
"""Largest number of supports that are all tried where the largest entries are uncertain."""


class Rule(NamedTuple):
    """Options of the solver that decide an exchange.

    everyone: True if all columns are candidates; growth, gain, hysteresis: as in
    `GreedyGaussNewton`; exchanges: largest number of exchanges.
    """

    everyone: bool
    growth: int | None
    gain: float
    hysteresis: float
    exchanges: int


class Proposal(NamedTuple):
    """Proposed support `kept`; order: test that its entries are the largest, if there is one."""

    kept: BoolArray
    order: Largest | None


class ExchangeScreen:
    """Fast test of exchanges (protocol `core.protocols.sparse_solver.Screen`); its caches affect
    the speed only."""

    def __init__(self, rule: Rule, groups: Sequence[Group], seen: BoolArray, rows: int) -> None:
        self.rule, self.groups, self.seen, self.rows = rule, tuple(groups), seen, rows
        self._order: dict[bytes, Largest | None] = {}
        self._proposed: BoolArray | None = None
        self.joining = Joining(groups, seen, rows, rule.growth)
        self.factors, self.refusals = Factors(), Refusals()
        self.fits = Fits(self.factors)

    def stays(self, at: Quadratic, support: BoolArray) -> bool:
        """True if the solver would certainly end on the support (protocol
        `core.protocols.sparse_solver.Screen`)."""
        if self.stands(at, support):
            return True
        if not self.rule.everyone and self.joining.share(support) < 1.0:
            return False
        unions = self._unions(at, support)
        if unions is None or len(unions) > 1:
            return False
        found = self._sizes(at, unions[0])
        if found is None or not self._is_largest(found, support):
            return False
        self._refused(at, support, Proposal(support, self._largest(support)))
        return True

    def reason(self, at: Quadratic, support: BoolArray) -> Reason | None:
        """Certificate that the support stays, None if there is none (protocol
        `core.protocols.sparse_solver.Screen`)."""
        order, others = self._largest(support), self.joining.others(support)
        inverse = self.factors.inverse(at, self.seen)
        if order is None or others is None or inverse is None:
            return None
        if self.rule.everyone:
            last = self.refusals.of(at, support)
            return OfAll.of(inverse, at.lengths, order) if last and last[0].move is None else None
        own = self.factors.inverse(at, support)
        whole = np.triu(at.gram) + np.triu(at.gram, 1).T
        return None if own is None else OfJoined.of(
            whole, own, inverse, at.lengths, order, others)

    def settle(self, at: Quadratic, support: BoolArray) -> BoolArray | None:
        """Support on which the solver would end, None if uncertain (protocol
        `core.protocols.sparse_solver.Screen`)."""
        if self.stands(at, support):
            return support
        found = self._settled(at, support)
        if found is None and at.exact is not None:
            return self._settled(at.exact(), support)
        return found

    def unlike(self, old: Quadratic, new: Quadratic, support: BoolArray) -> GramError:
        """Bound on the error of `old` for `new`: of sizes near the threshold of each group, and of
        the rise of the squared norm by an exchange (protocol
        `core.protocols.sparse_solver.Screen`)."""
        seen: list[list[FloatArray]] = []
        rises: list[tuple[float, float]] = []
        kept = support
        for at in (old, new):
            found = [self._sizes(at, self.seen)]
            found += [] if self.rule.everyone else [self._correlations(at, support)]
            if not seen and found[0] is not None:
                kept = np.concatenate([first(found[0].sizes[g.start : g.stop], g.budget or 0)
                                       for g in self.groups])
            move = self.factors.move(at, support, kept)
            if move is None or None in found:
                return UNKNOWN
            seen.append([f.sizes for f in found if f is not None])
            rises.append(move.rise(at))
        (a, _), (b, error) = rises
        return GramError(
            max(apart(n[g.start : g.stop], o[g.start : g.stop], g.budget or 0)
                for o, n in zip(*seen, strict=True) for g in self.groups),
            new.error.gram * abs(b - a) / max(error, TINY))

    def stands(self, at: Quadratic, support: BoolArray) -> bool:
        """True if one of the latest rejections of an exchange holds again, so that the support
        stays."""
        reasons = self.refusals.of(at, support)
        found = self._sizes(at, self.seen) if reasons else None
        if found is None:
            return False
        for why in reasons:
            if not why.order.holds(found.sizes, found.close):
                continue
            if why.move is not None:
                rise, error = why.move.rise(at)
                if not rise > error and self.fits.compared(
                        at, support, why.kept, (rise, error), self.rule.hysteresis) is not support:
                    continue
            self.refusals.first(why)
            return True
        return False

    def _refused(self, at: Quadratic, support: BoolArray, what: Proposal) -> None:
        """Records a rejected exchange: later steps with the same Gram matrix most often reject it
        again."""
        if not self.rule.everyone or what.order is None:
            return
        same = what.kept is support or np.array_equal(what.kept, support)
        move = None if same else self.factors.move(at, support, what.kept)
        if same or move is not None:
            self.refusals.remember(at, support, Refusal(what.kept, what.order, move))

    def _settled(self, at: Quadratic, support: BoolArray) -> BoolArray | None:
        """Support on which subspace pursuit ends; None if uncertain."""
        now, rule = support, self.rule
        if rule.everyone and self.fits.never_valid(at, support, self.seen, rule.hysteresis):
            return support
        for _ in range(rule.exchanges):
            given = now is support or np.array_equal(now, support)
            new = self._exchange(at, now, rule.hysteresis if given else rule.gain)
            if new is None or new is now:
                return new
            at, now = _without(at, np.flatnonzero((at.c != 0.0) & ~new)), new
        return None

    def _exchange(
        self, at: Quadratic, support: BoolArray, gain: float
    ) -> BoolArray | None:
        """Support after one exchange, the same object if none is accepted, None if uncertain.

        Where an intermediate choice is closer than the tolerance, both branches are followed; they
        have to end on the same support.
        """
        unions, ends = self._unions(at, support), list[BoolArray]()
        for union in unions or ():
            found = self._sizes(at, union)
            if found is None:
                return None
            proposals = self._proposals(at, support, found, gain)
            if proposals is None:
                return None
            for what in proposals:
                end = self.fits.better(at, support, what.kept, gain)
                if end is None or (ends and not np.array_equal(end, ends[0])):
                    return None
                ends.append(end)
                if end is support and len(proposals) == 1:
                    self._refused(at, support, what)
        return ends[0] if ends else None

    def _proposals(
        self, at: Quadratic, support: BoolArray, found: Sizes, gain: float
    ) -> Sequence[Proposal] | None:
        """Supports of the `budget` largest of each group, all that are possible within the
        tolerance; None: too many."""
        # what was proposed in the last step is most often proposed again
        for likely in (self._proposed, support):
            if likely is not None and self._is_largest(found, likely):
                return self._proposal(likely)
        ways = choices(found.sizes, self.groups, found.close)
        if len(ways) == 1:
            return self._proposal(ways[0])
        # all that may be meant together, if they fit no better: no choice of them does
        able = reach(found.sizes, self.groups, found.close)
        if self.fits.better(at, support, able, gain) is support:
            likely = np.concatenate([first(found.sizes[g.start : g.stop], g.budget or 0)
                                     for g in self.groups])
            return (Proposal(able, Largest.among(likely, likely | ~able, self.groups)),)
        if not 0 < len(ways) <= FEW_WAYS:
            return None
        return [Proposal(way, None) for way in ways]

    def _proposal(self, likely: BoolArray) -> Sequence[Proposal]:
        """Sequence with a single proposed support, which is tried first in the next step."""
        self._proposed = likely
        return (Proposal(likely, self._largest(likely)),)

    def _largest(self, support: BoolArray) -> Largest | None:
        key = support.tobytes()
        if key not in self._order:
            room(self._order)[key] = Largest.of(support, self.groups)
        return self._order[key]

    def _is_largest(self, found: Sizes, support: BoolArray) -> bool:
        """True if the active entries of each group are certainly its largest."""
        order = self._largest(support)
        return order is not None and order.holds(found.sizes, found.close)

    def _unions(
        self, at: Quadratic, support: BoolArray
    ) -> Sequence[BoolArray] | None:
        """Masks of the support and its candidates: all columns, or those that correlate most with
        its residual; None if uncertain."""
        if self.rule.everyone:
            return (self.seen,)
        found = self._correlations(at, support)
        if found is None:
            return None
        return self.joining.unions(found, support)

    def _correlations(self, at: Quadratic, support: BoolArray) -> Sizes | None:
        """Correlations (k,) of all columns with the residual of least squares on the support, zero
        on it; None for nearly dependent columns."""
        own = self.factors.fitted(at, support)
        if own is None:
            return None
        columns, step, _ = own
        full = np.zeros(len(at.c))
        full[columns] = step
        left = blas.dsymv(-1.0, at.gram, full, 1.0, at.slope)
        left[columns] = 0.0
        return Sizes(np.abs(left / at.lengths), Tolerance(
            at.error.sizes, EPS * len(full) * sqrt(float(step.dot(step)))))

    def _sizes(self, at: Quadratic, union: BoolArray) -> Sizes | None:
        """Sizes (k,) of the least-squares coefficients on `union`, zero elsewhere, as c must be;
        None for nearly dependent columns."""
        own = self.factors.fitted(at, union)
        if own is None:
            return None
        columns, step, rounding = own
        if len(columns) == len(at.c):
            z = at.c - step
        else:
            z = np.zeros(len(at.c))
            z[columns] = at.c[columns] - step
        return Sizes(np.abs(at.lengths * z), Tolerance(
            at.error.sizes, rounding * self.factors.longest))


def _without(at: Quadratic, columns: IntArray) -> Quadratic:
    """Quadratic form `at` after these coefficients are set to zero."""
    c, step = at.c.copy(), np.zeros(len(at.c))
    c[columns], step[columns] = 0.0, -at.c[columns]
    bent = blas.dsymv(1.0, at.gram, step)
    rise = float(step.dot(2.0 * at.slope + bent))

    def left() -> tuple[float, float]:
        square, hidden = at.left()
        return square + rise, hidden

    return at._replace(slope=at.slope + bent, c=c, left=left)
