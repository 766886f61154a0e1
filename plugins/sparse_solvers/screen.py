"""The exchange of greedy Gauss-Newton on a Jacobian that stays, with its factors kept.

What a step asks most is whether the support would stay: one product, where the step before refused
the same (standing.py).
"""

from collections.abc import Sequence
from itertools import product
from math import sqrt
from typing import NamedTuple, TypeVar

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.protocols import Group
from sparsemor.core.screening import Screen, Tolerance
from sparsemor.plugins.sparse_solvers.active_set import EPS
from sparsemor.plugins.sparse_solvers.largest import (
    Largest,
    apart,
    choices,
    first,
    reach,
    within,
)
from sparsemor.plugins.sparse_solvers.normal import Columns, Everyone
from sparsemor.plugins.sparse_solvers.standing import Refusal, Refusals, Standing

T = TypeVar("T")
KEPT = 64
"""Factors kept at once; a support or a proposal often comes back."""
TINY, UNTOLD = 1e-300, Tolerance(np.inf, np.inf)
FEW_WAYS = 4
"""Proposals that may be meant and are still tried, all of them."""
FEW = 12
"""Columns that are taken out of the least squares on all of them; more: it is factorized anew."""


class Rule(NamedTuple):
    """The options of the solver that decide an exchange."""

    everyone: bool
    growth: int | None
    gain: float
    rank_rtol: float
    exchanges: int


class LinearScreen:
    """Implements `core.screening.Screen`. J (m, k) is kept with columns over `norms`."""

    def __init__(
        self, rule: Rule, J: FloatArray, norms: FloatArray, groups: Sequence[Group], rows: int
    ) -> None:
        self.rule, self.norms, self.groups, self.rows = rule, norms, tuple(groups), rows
        self.J = J / np.where(norms > 0.0, norms, 1.0)
        self.seen = norms > 0.0
        self._everyone = Everyone.of(self.J, self.seen, rule.rank_rtol)
        self._columns: dict[bytes, Columns | None] = {}
        self._order: dict[bytes, Largest | None] = {}
        self._held: dict[bytes, FloatArray | None] = {}
        self._proposed: BoolArray | None = None
        self._joined: tuple[bytes, BoolArray, Largest] | None = None
        self._refusal: Refusal | None = None
        self._refusals = Refusals()

    def stays(
        self, r: FloatArray, c: FloatArray, support: BoolArray, sizes: float
    ) -> bool:
        """See `core.screening.Screen`."""
        z, alike = self.norms * c, Tolerance(sizes, sizes)
        if self._refusals.stands(r, z, support, 0.0, self.rule.gain, alike):
            return True
        unions = self._unions(r, z, support, sizes)
        if unions is None or len(unions) > 1 or not (
                self.rule.everyone or self._share(support) >= 1.0):
            return False
        (union,) = unions
        found = self._sizes(r, z, union)
        if found is None or not self._is_largest(found, support, sizes):
            return False
        self._stand(support, Refusal(union, support, found))
        return True

    def settle(
        self, r: FloatArray, c: FloatArray, support: BoolArray, beside: float,
        tolerance: Tolerance,
    ) -> BoolArray | None:
        """See `core.screening.Screen`: subspace pursuit until the support reproduces itself."""
        z, now = self.norms * c, support
        floor = 100.0 * EPS * sqrt(float(z.dot(z)) + beside * beside)
        if self._refusals.stands(r, z, support, floor, self.rule.gain, tolerance):
            return support
        for _ in range(self.rule.exchanges):
            self._refusal = None
            new = self._exchange(r, z, now, floor, tolerance)
            if new is None or new is now:
                if new is support and self._refusal is not None:
                    self._stand(support, self._refusal)
                return new
            gone = np.flatnonzero((z != 0.0) & ~new)  # c goes on with zeros there
            r, now = r - self.J[:, gone].dot(z[gone]), new
            z = np.where(new, z, 0.0)
        return None

    def _stand(self, support: BoolArray, refusal: Refusal) -> None:
        """A refusal that follows another on the same support will be met again."""
        met = self._refusals.again(support, refusal)
        if met is None:
            return
        own, same = self._factor(support), np.array_equal(support, met.able)
        other, W = None if same else self._factor(met.able), self._all_but(met.union)
        if W is None:
            f = self._factor(met.union)
            W = None if f is None else f.inverse(len(self.norms))
        if own is not None and W is not None and (same or other is not None):
            self._refusals.standing = support, Standing.of(self.J, own, other, W, support, met,
                                                           not self.rule.everyone, self.groups)

    def unlike(
        self, other: Screen, r: FloatArray, c: FloatArray, support: BoolArray
    ) -> Tolerance:
        """Of the sizes near the threshold of each group, and of the norm that is left."""
        if not isinstance(other, LinearScreen):
            return UNTOLD
        z = self.norms * c
        joined = self._unions(r, z, support, 0.0)
        union = self.seen if joined is None else joined[0]
        # the other has its own object for all columns
        both = union if union is not self.seen else other.seen
        a, b = self._sizes(r, z, union), other._sizes(r, other.norms * c, both)
        if a is None or b is None:
            return UNTOLD
        kept = np.concatenate([first(a[g.start : g.stop], g.budget or 0) for g in self.groups])
        left = [[s._norm_on(r, s.norms * c, on) for on in (support, kept)] for s in (self, other)]
        if not np.isfinite(left).all():
            return UNTOLD
        return Tolerance(
            max(apart(a[g.start : g.stop], b[g.start : g.stop], g.budget or 0)
                for g in self.groups),
            max(abs(m - n) / max(m, left[0][0], TINY) for m, n in zip(*left, strict=True)))

    def _exchange(
        self, r: FloatArray, z: FloatArray, support: BoolArray, floor: float,
        tolerance: Tolerance,
    ) -> BoolArray | None:
        """The support after one exchange, the same object if none is taken, None if unsure.

        Where a choice on the way is closer than the tolerance, both ways are gone; they have to
        end on the same support.
        """
        unions = self._unions(r, z, support, tolerance.sizes)
        if unions is None:
            return None
        ends: list[BoolArray] = []
        for union in unions:
            sizes = self._sizes(r, z, union)
            if sizes is None:
                return None
            kept = self._guessed(sizes, support, tolerance.sizes)
            if kept is None:
                able = reach(sizes, self.groups, tolerance.sizes)
            if kept is None and self._better(
                    r, z, support, able, floor, tolerance.norms) is support:
                self._refusal = Refusal(union, able, sizes) if len(unions) == 1 else None
                if ends and not np.array_equal(support, ends[0]):
                    return None
                ends.append(support)
                continue
            if kept is None:
                kept = choices(sizes, self.groups, tolerance.sizes)
                self._proposed = kept[0] if len(kept) == 1 else self._proposed
            if not 0 < len(kept) <= FEW_WAYS:
                return None
            if len(unions) == len(kept) == 1:
                self._refusal = Refusal(union, kept[0], sizes)
            for proposal in kept:
                end = self._better(r, z, support, proposal, floor, tolerance.norms)
                if end is None or (ends and not np.array_equal(end, ends[0])):
                    return None
                ends.append(end)
        return ends[0]

    def _guessed(
        self, sizes: FloatArray, support: BoolArray, tolerance: float
    ) -> Sequence[BoolArray] | None:
        """The `budget` largest of each group, if they are those of the last step or the support."""
        # what was proposed and refused in the last step is most often proposed again
        if self._proposed is not None and self._is_largest(sizes, self._proposed, tolerance):
            return (self._proposed,)
        if self._is_largest(sizes, support, tolerance):
            self._proposed = None
            return (support,)
        return None

    def _is_largest(self, sizes: FloatArray, support: BoolArray, tolerance: float) -> bool:
        """Are the active entries of each group its largest, by more than the tolerance?"""
        key = support.tobytes()
        if key not in self._order:
            _room(self._order)[key] = Largest.of(support, self.groups)
        order = self._order[key]
        return order is not None and order.holds(sizes, tolerance)

    def _better(
        self, r: FloatArray, z: FloatArray, support: BoolArray, kept: BoolArray, floor: float,
        tolerance: float,
    ) -> BoolArray | None:
        """`kept` when it fits enough better than `support`, which is handed back if not."""
        if kept is support or kept.tobytes() == support.tobytes():
            return support
        own, other = self._factor(support), self._factor(kept)
        if own is None or other is None:
            return None
        base = own.norm(r)
        if 0.5 * floor < base < 2.0 * floor:
            return None
        new = other.norm(self._without(r, z, kept))
        least = base - max(self.rule.gain * base, floor)
        if base > floor and not abs(new - least) > tolerance * max(base, new):
            return None
        return support if base <= floor or new >= least else kept

    def _unions(
        self, r: FloatArray, z: FloatArray, support: BoolArray, tolerance: float
    ) -> Sequence[BoolArray] | None:
        """The support and the columns that correlate most with what it leaves, or all columns."""
        if self.rule.everyone:
            return (self.seen,)
        if (f := self._factor(support)) is None:
            return None
        correlation, key, last = np.abs(f.left(r).dot(self.J)), support.tobytes(), self._joined
        if last is not None and last[0] == key and last[2].holds(correlation, tolerance):
            return (last[1],)
        share, growth, ways = self._share(support), self.rule.growth, []
        for g in self.groups:
            active = support[g.start : g.stop]
            part = np.where(active, 0.0, correlation[g.start : g.stop])
            some = within(part, int(share * min(g.budget or 0, growth or g.budget or 0)), tolerance)
            if some is None:
                return None
            ways.append([active | more for more in some])
        found = [np.concatenate(p) for p in product(*ways)]
        if len(found) == 1:
            self._joined = key, found[0], Largest.among(found[0], ~support, self.groups)
        return found if len(found) <= 2 else None

    def _share(self, support: BoolArray) -> float:
        """Share of the wanted columns that there are rows for."""
        growth = self.rule.growth
        wanted = sum(min(g.budget or 0, growth or g.budget or 0) for g in self.groups)
        return min(1.0, (self.rows - int(np.count_nonzero(support))) / max(1, wanted))

    def _sizes(self, r: FloatArray, z: FloatArray, union: BoolArray) -> FloatArray | None:
        """(k,) sizes of the coefficients of least squares on `union`, zero elsewhere; z is zero
        there, too."""
        W = self._all_but(union)
        if W is not None:
            return np.asarray(np.abs(z - W.dot(r)))
        f = self._factor(union)
        if f is None:
            return None
        sizes = np.zeros(len(z))
        sizes[f.columns] = np.abs(z[f.columns] - f.step(r))
        return sizes

    def _all_but(self, union: BoolArray) -> FloatArray | None:
        """(k, m) what takes z to the least squares on a union that leaves out few; else None."""
        e = self._everyone
        if e is None or union is self.seen:
            return None if e is None else e.W
        key = union.tobytes()
        if key not in self._held:
            out: IntArray = np.flatnonzero(~union)
            _room(self._held)[key] = e.holding(out) if len(out) <= FEW else None
        return self._held[key]

    def _norm_on(self, r: FloatArray, z: FloatArray, support: BoolArray) -> float:
        """What least squares on `support` leaves of r at z; inf for dependent columns."""
        f = self._factor(support)
        return np.inf if f is None else f.norm(self._without(r, z, support))

    def _without(self, r: FloatArray, z: FloatArray, support: BoolArray) -> FloatArray:
        """(m,) the residual without the columns that are not in the support."""
        gone: IntArray = np.flatnonzero((z != 0.0) & ~support)
        return r - self.J[:, gone].dot(z[gone]) if len(gone) else r

    def _factor(self, support: BoolArray) -> Columns | None:
        """None when the columns are dependent."""
        key = support.tobytes()
        if key not in self._columns:
            _room(self._columns)[key] = Columns.of(
                self.J, np.flatnonzero(support), self.rule.rank_rtol)
        return self._columns[key]


def _room(kept: dict[bytes, T]) -> dict[bytes, T]:
    """The same dictionary, the oldest entry dropped when it is full."""
    if len(kept) >= KEPT:
        kept.pop(next(iter(kept)))
    return kept
