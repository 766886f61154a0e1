"""Why a support stays, as one product: the refusal that most steps repeat.

From step to step the same columns would join, and what could be kept of them is refused again: it
fits no better. For a fixed support and fixed columns every quantity that decides is linear in
(r, z), so one matrix holds them all: correlations, least-squares coefficients, and what the support
and the others reach of r.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.protocols import Group
from sparsemor.core.screening import Tolerance
from sparsemor.plugins.sparse_solvers.largest import Largest, first
from sparsemor.plugins.sparse_solvers.normal import Columns

HALF = 1e-8
"""Share of a squared norm that a difference of two must leave: half of the digits."""


class Refusal(NamedTuple):
    """What an exchange considered: the columns that could be kept (`union`), those of them that
    could be among the largest (`able`), and their sizes (k,) as least squares on the union."""

    union: BoolArray
    able: BoolArray
    sizes: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """`all` (q + s + o, m + k) on (r, z). The first q rows are compared: `starts` are the borders
    of lists, each that has to be the larger one before the one that has to be the smaller. The
    next s rows are what the support reaches of r, the last o what all that is able reaches of r
    without the columns `gone` (m, j), number `at` (None: all that is able is the support)."""

    all: FloatArray
    starts: IntArray
    compared: int
    own: int
    gone: FloatArray | None
    at: IntArray

    @classmethod
    def of(
        cls, J: FloatArray, own: Columns, other: Columns | None, W: FloatArray,
        support: BoolArray, refusal: Refusal, chosen: bool, groups: Sequence[Group],
    ) -> "Standing":
        """own, other: factors of the support and of what is able (None if that is the support);
        W (k, m): z - W r are the coefficients on the union, which was chosen if `chosen`."""
        m, k = J.shape
        kept = np.concatenate([first(refusal.sizes[g.start : g.stop], g.budget or 0)
                               for g in groups])
        order = Largest.among(kept, kept | ~refusal.able, groups)
        joins = Largest.among(refusal.union & ~support, ~support, groups) if chosen else None
        n, q = (0, 0) if joins is None else (len(joins.order), len(joins.order))
        q += len(order.order)
        reach = 0 if other is None else len(own.columns) + len(other.columns)
        A = np.zeros((q + reach, m + k))
        starts = [order.starts[: q - n] + n]
        if joins is not None:
            A[:n, :m] = J[:, joins.order].T
            A[:n, :m] -= (A[:n, :m] @ own.Q) @ own.Qt
            starts.insert(0, joins.starts[:n])
        A[n:q, :m] = -W[order.order]
        A[np.arange(n, q), m + order.order] = 1.0
        gone, at = None, np.flatnonzero(support & ~refusal.able)
        if other is not None:
            s = q + len(own.columns)
            gone = np.ascontiguousarray(J[:, at])
            A[q:s, :m], A[s:, :m] = own.Qt, other.Qt
            A[s:, m + at] = -(other.Qt @ gone)
        return cls(A, np.concatenate(starts), q, len(own.columns), gone, at)

    def holds(
        self, r: FloatArray, z: FloatArray, floor: float, gain: float, tolerance: Tolerance
    ) -> bool:
        """Does all of it hold still, by more than the tolerance? z is zero off the support."""
        out, q = self.all.dot(np.concatenate((r, z))), self.compared
        if not q:
            return False
        sizes = np.abs(out[:q])
        least = np.minimum.reduceat(sizes, self.starts)[::2]
        most = np.maximum.reduceat(sizes, self.starts)[1::2]
        if not (least > (1.0 + tolerance.sizes) * most).all():
            return False
        if self.gone is None:
            return True
        without = r - self.gone.dot(z[self.at])
        base, new = (_rest(v, reached) for v, reached in (
            (r, out[q : q + self.own]), (without, out[q + self.own :])))
        if not (base > 2.0 * floor and new > 0.0):
            return False
        return new - (base - max(gain * base, floor)) > tolerance.norms * max(base, new)


class Refusals:
    """The last refusal, and the matrix of one that came twice."""

    def __init__(self) -> None:
        self.before: tuple[BoolArray, Refusal] | None = None
        self.standing: tuple[BoolArray, Standing] | None = None

    def stands(
        self, r: FloatArray, z: FloatArray, support: BoolArray, floor: float, gain: float,
        tolerance: Tolerance,
    ) -> bool:
        """Is what refused an exchange on this support in an earlier step still all true?"""
        known = self.standing
        return known is not None and known[0] is support and known[1].holds(
            r, z, floor, gain, tolerance)

    def again(self, support: BoolArray, refusal: Refusal) -> Refusal | None:
        """The refusal, if it follows another one of the same columns on the same support."""
        before, self.before = self.before, (support, refusal)
        if before is None or before[0] is not support or not np.array_equal(
                before[1].union, refusal.union):
            return None
        return refusal


def _rest(v: FloatArray, reached: FloatArray) -> float:
    """Norm of what is not reached of v; -1 where the difference of squares would not tell."""
    whole = float(v.dot(v))
    square = whole - float(reached.dot(reached))
    return sqrt(square) if square > HALF * whole else -1.0
