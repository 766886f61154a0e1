"""The exchange of greedy Gauss-Newton where the residual is linear, from its Gram matrix.

Fits are compared by their difference to the solution of the step, so that squared norms do not
lose the digits that decide.
"""

from collections.abc import Sequence
from itertools import product
from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import blas

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.protocols import Group
from sparsemor.core.screening import Error, Quadratic
from sparsemor.plugins.sparse_solvers.active_set import EPS
from sparsemor.plugins.sparse_solvers.factors import Factors, room
from sparsemor.plugins.sparse_solvers.largest import (
    Largest,
    Tolerance,
    apart,
    choices,
    first,
    reach,
    within,
)
from sparsemor.plugins.sparse_solvers.refusal import Refusal

TINY, UNTOLD = 1e-300, Error(np.inf, np.inf)
CLOSE = 1e-6
"""Relative difference of norms that are not told apart."""
FEW_WAYS = 4
"""Proposals that may be meant and are still tried, all of them."""


class Rule(NamedTuple):
    """The options of the solver that decide an exchange."""

    everyone: bool
    growth: int | None
    gain: float
    exchanges: int


class Sizes(NamedTuple):
    """(k,) sizes of coefficients as they are compared, and how close is too close."""

    sizes: FloatArray
    close: Tolerance


class ExchangeScreen:
    """Implements `core.screening.Screen`. What it keeps between steps only saves work."""

    def __init__(self, rule: Rule, groups: Sequence[Group], seen: BoolArray, rows: int) -> None:
        self.rule, self.groups, self.seen, self.rows = rule, tuple(groups), seen, rows
        self._order: dict[bytes, Largest | None] = {}
        self._proposed: BoolArray | None = None
        self._joined: tuple[bytes, BoolArray, Largest] | None = None
        self.factors = Factors()
        self._last: Refusal | None = None

    def stays(self, at: Quadratic, support: BoolArray) -> bool:
        """See `core.screening.Screen`."""
        last = self._last
        if last is not None and last.stands(at, support):
            return True
        if not self.rule.everyone and self._share(support) < 1.0:
            return False
        unions = self._unions(at, support)
        if unions is None or len(unions) > 1:
            return False
        found = self._sizes(at, unions[0])
        if found is None or not self._is_largest(found, support):
            return False
        self._refused(at, support, support, self._order.get(support.tobytes()))
        return True

    def settle(self, at: Quadratic, support: BoolArray) -> BoolArray | None:
        """See `core.screening.Screen`."""
        last = self._last
        if last is not None and last.stands(at, support):
            return support
        found = self._settled(at, support)
        if found is None and at.exact is not None:
            return self._settled(at.exact(), support)
        return found

    def unlike(self, old: Quadratic, new: Quadratic, support: BoolArray) -> Error:
        """See `core.screening.Screen`: of sizes near the threshold of each group, and of a rise."""
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
                return UNTOLD
            seen.append([f.sizes for f in found if f is not None])
            rises.append(move.rise(at))
        (a, _), (b, error) = rises
        return Error(
            max(apart(n[g.start : g.stop], o[g.start : g.stop], g.budget or 0)
                for o, n in zip(*seen, strict=True) for g in self.groups),
            new.error.gram * abs(b - a) / max(error, TINY))

    def _settled(self, at: Quadratic, support: BoolArray) -> BoolArray | None:
        """Subspace pursuit until the support reproduces itself."""
        now = support
        for _ in range(self.rule.exchanges):
            new = self._exchange(at, now)
            if new is None or new is now:
                return new
            at, now = _without(at, np.flatnonzero((at.c != 0.0) & ~new)), new
        return None

    def _exchange(self, at: Quadratic, support: BoolArray) -> BoolArray | None:
        """The support after one exchange, the same object if none is taken, None if unsure.

        Where a choice on the way is closer than the tolerance, both ways are gone; they have to
        end on the same support.
        """
        unions, ends = self._unions(at, support), list[BoolArray]()
        for union in unions or ():
            found = self._sizes(at, union)
            if found is None:
                return None
            proposals = self._proposals(at, support, found)
            if proposals is None:
                return None
            for kept in proposals:
                end = self._better(at, support, kept)
                if end is None or (ends and not np.array_equal(end, ends[0])):
                    return None
                ends.append(end)
        return ends[0] if ends else None

    def _proposals(
        self, at: Quadratic, support: BoolArray, found: Sizes
    ) -> Sequence[BoolArray] | None:
        """The `budget` largest of each group, in all ways that may be meant; None: too many."""
        # what was proposed in the last step is most often proposed again
        for likely in (self._proposed, support):
            if likely is not None and self._is_largest(found, likely):
                self._proposed = likely
                return (likely,)
        ways = choices(found.sizes, self.groups, found.close)
        if len(ways) == 1:
            self._proposed = ways[0]
            return ways
        # all that may be meant together, if they fit no better: no choice of them does
        able = reach(found.sizes, self.groups, found.close)
        if self._better(at, support, able) is support:
            likely = np.concatenate([first(found.sizes[g.start : g.stop], g.budget or 0)
                                     for g in self.groups])
            self._refused(at, support, able, Largest.among(likely, likely | ~able, self.groups))
            return (support,)
        return ways if 0 < len(ways) <= FEW_WAYS else None

    def _is_largest(self, found: Sizes, support: BoolArray) -> bool:
        """Are the active entries of each group its largest, for sure?"""
        key = support.tobytes()
        if key not in self._order:
            room(self._order)[key] = Largest.of(support, self.groups)
        order = self._order[key]
        return order is not None and order.holds(found.sizes, found.close)

    def _better(
        self, at: Quadratic, support: BoolArray, kept: BoolArray
    ) -> BoolArray | None:
        """`kept` when it fits enough better than `support`, which is handed back if not."""
        old, key = support.tobytes(), kept.tobytes()
        if key == old:
            self._refused(at, support, kept, self._order.get(key))
            return support
        move = self.factors.move(at, support, kept)
        if move is None:
            return None
        rise, error = move.rise(at)
        if rise > error:
            self._refused(at, support, kept, self._order.get(key))
            return support  # worse than the step's solution, which its own fit does not exceed
        return self._compared(at, support, kept, rise, error)

    def _refused(
        self, at: Quadratic, support: BoolArray, kept: BoolArray, order: Largest | None
    ) -> None:
        """Steps that follow with the same Gram matrix most often refuse the same."""
        everyone, move = self.factors.known(self.seen), None
        if not self.rule.everyone or everyone is None or order is None or not self.seen.all():
            return
        if kept is not support and kept.tobytes() != support.tobytes():
            move = self.factors.move(at, support, kept)
        self._last = Refusal(at.gram, support, everyone, order, move, self.factors.longest)

    def _compared(
        self, at: Quadratic, support: BoolArray, kept: BoolArray, rise: float, error: float
    ) -> BoolArray | None:
        """The same from the norms themselves; `kept` leaves the squared norm at `at` and rise."""
        own = self.factors.fitted(at, support)
        if own is None:
            return None
        square, hidden = at.left()
        z, fallen = at.lengths * at.c, float(at.slope[support].dot(own[1]))
        floor = 100.0 * EPS * sqrt(float(z.dot(z)) + hidden)
        base, new = (sqrt(max(s, 0.0)) for s in (square - fallen, square + rise))
        if 0.5 * floor < base < 2.0 * floor:
            return None
        least = base - max(self.rule.gain * base, floor)
        top = max(base, new)
        close = CLOSE * top + at.error.sizes * floor
        if base > floor and not abs(new - least) * top > close * top + error:
            return None
        return support if base <= floor or new >= least else kept

    def _unions(
        self, at: Quadratic, support: BoolArray
    ) -> Sequence[BoolArray] | None:
        """The support and the columns that correlate most with what it leaves, or all columns."""
        if self.rule.everyone:
            return (self.seen,)
        found = self._correlations(at, support)
        if found is None:
            return None
        key, last, close = support.tobytes(), self._joined, found.close
        if last is not None and last[0] == key and last[2].holds(found.sizes, close):
            return (last[1],)
        share, growth, ways = self._share(support), self.rule.growth, []
        for g in self.groups:
            active, part = support[g.start : g.stop], found.sizes[g.start : g.stop]
            some = within(part, int(share * min(g.budget or 0, growth or g.budget or 0)), close)
            if some is None:
                return None
            ways.append([active | more for more in some])
        unions = [np.concatenate(p) for p in product(*ways)]
        if len(unions) == 1:
            self._joined = key, unions[0], Largest.among(unions[0], ~support, self.groups)
        return unions if len(unions) <= 2 else None

    def _correlations(self, at: Quadratic, support: BoolArray) -> Sizes | None:
        """(k,) of all columns with what least squares on the support leaves, zero on it."""
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

    def _share(self, support: BoolArray) -> float:
        """Share of the wanted columns that there are rows for."""
        growth = self.rule.growth
        wanted = sum(min(g.budget or 0, growth or g.budget or 0) for g in self.groups)
        return min(1.0, (self.rows - int(np.count_nonzero(support))) / max(1, wanted))

    def _sizes(self, at: Quadratic, union: BoolArray) -> Sizes | None:
        """Of the coefficients of least squares on `union`, zero elsewhere; c is zero there, too."""
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
    """The same where these coefficients are zero."""
    c, step = at.c.copy(), np.zeros(len(at.c))
    c[columns], step[columns] = 0.0, -at.c[columns]
    bent = blas.dsymv(1.0, at.gram, step)
    rise = float(step.dot(2.0 * at.slope + bent))

    def left() -> tuple[float, float]:
        square, hidden = at.left()
        return square + rise, hidden

    return at._replace(slope=at.slope + bent, c=c, left=left)
