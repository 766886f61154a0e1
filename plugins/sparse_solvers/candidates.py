"""Candidate columns for a support: those that correlate most with its residual."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from sparsemor.core import BoolArray, FloatArray, Group, IntArray
from sparsemor.plugins.sparse_solvers.factors import room
from sparsemor.plugins.sparse_solvers.hard_thresholding import Sizes, Tolerance, within


@dataclass(frozen=True, slots=True, eq=False)
class Others:
    """Columns outside a support, by group.

    out: number of columns in each group that are not candidates; size: number of all columns, none
    of which is zero.
    """

    columns: list[IntArray]
    out: list[int]
    size: int

    @classmethod
    def of(
        cls, support: BoolArray, groups: Sequence[Group], joining: Sequence[int]
    ) -> "Others":
        columns = [np.flatnonzero(~support[g.start : g.stop]) + g.start for g in groups]
        return cls(columns, [max(len(c) - n, 0) for c, n in zip(columns, joining, strict=True)],
                   len(support))

    def left_out(self, sizes: Sequence[FloatArray], tolerance: Tolerance) -> list[IntArray] | None:
        """Columns that are not candidates: those of smallest `sizes` (one array per group); None if
        a comparison is within the tolerance."""
        found, (relative, absolute) = [], tolerance
        for columns, a, out in zip(self.columns, sizes, self.out, strict=True):
            if not out:
                continue
            order = a.argsort()
            if out < len(order) and not a[order[out]] > (
                    1.0 + relative) * a[order[out - 1]] + absolute:
                return None
            found.append(columns[order[:out]])
        return found

    def union(self, sizes: FloatArray, tolerance: Tolerance) -> BoolArray | None:
        """Mask (k,) of the support and its candidates, chosen by `sizes` (k,); None if a comparison
        is within the tolerance."""
        out = self.left_out([sizes[c] for c in self.columns], tolerance)
        if out is None:
            return None
        union = np.ones(self.size, dtype=np.bool_)
        for columns in out:
            union[columns] = False
        return union


class Joining:
    """Candidate columns of supports, for problems with given groups of columns.

    seen (k,): columns that are not zero; rows: number of rows; growth: largest number of candidates
    per group, by default its budget (largest number of active columns).
    """

    def __init__(
        self, groups: Sequence[Group], seen: BoolArray, rows: int, growth: int | None
    ) -> None:
        self.groups, self.seen, self.rows, self.growth = tuple(groups), seen, rows, growth
        self._others: dict[bytes, Others | None] = {}

    def wanted(self) -> list[int]:
        """Number of candidates of each group if there are enough rows."""
        return [min(g.budget or 0, self.growth or g.budget or 0) for g in self.groups]

    def share(self, support: BoolArray) -> float:
        """Share of the wanted candidates for which there are enough rows."""
        return min(1.0, (self.rows - int(np.count_nonzero(support))) / max(1, sum(self.wanted())))

    def counts(self, support: BoolArray) -> list[int]:
        """Number of candidates of each group."""
        share = self.share(support)
        return [int(share * n) for n in self.wanted()]

    def others(self, support: BoolArray) -> Others | None:
        """Columns outside the support; None where some column is zero."""
        key = support.tobytes()
        if key not in self._others:
            room(self._others)[key] = Others.of(
                support, self.groups, self.counts(support)) if self.seen.all() else None
        return self._others[key]

    def unions(self, left: Sizes, support: BoolArray) -> Sequence[BoolArray] | None:
        """Masks (k,) of the support with its candidates, by correlations (k,) that are zero on the
        support: one, or two where one comparison is uncertain; None if more are."""
        others = self.others(support)
        union = None if others is None else others.union(left.sizes, left.close)
        if union is not None:
            return (union,)
        ways = []
        for g, count in zip(self.groups, self.counts(support), strict=True):
            some = within(left.sizes[g.start : g.stop], count, left.close)
            if some is None:
                return None
            ways.append([support[g.start : g.stop] | more for more in some])
        unions = [np.concatenate(p) for p in product(*ways)]
        return unions if len(unions) <= 2 else None
