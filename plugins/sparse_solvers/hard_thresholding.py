"""Hard thresholding: the largest entries of a vector, and whether they are certainly the largest
despite errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from sparsemor.core import BoolArray, FloatArray, Group, IntArray


class Tolerance(NamedTuple):
    """Margin by which an entry must exceed another to be certainly the larger one."""

    relative: float
    absolute: float = 0.0

    def over(self, size: float) -> float:
        """Value above which an entry is certainly larger than one of the given size."""
        return (1.0 + self.relative) * size + self.absolute


class Sizes(NamedTuple):
    """Sizes (k,) of coefficients that are compared, and the tolerance of the comparisons."""

    sizes: FloatArray
    close: Tolerance


@dataclass(frozen=True, slots=True, eq=False)
class Largest:
    """Test that the active columns of each group are its largest.

    order: for each group its active columns, then its other ones; starts: where each of these lists
    begins; signs: 1 for active columns, -1 for others.
    """

    order: IntArray
    starts: IntArray
    signs: FloatArray

    @classmethod
    def listed(cls, sides: Sequence[IntArray]) -> "Largest":
        """Test from lists of columns: active and other ones of the first group, of the second, and
        so on."""
        lengths = [len(side) for side in sides]
        signs = np.repeat(np.resize([1.0, -1.0], len(lengths)), lengths)
        return cls(np.concatenate([np.zeros(0, np.int64), *sides]),
                   np.cumsum([0, *lengths[:-1]]), signs)

    @classmethod
    def of(cls, support: BoolArray, groups: Sequence[Group]) -> "Largest | None":
        """Test for a support; None where a group does not use its whole budget or has no inactive
        column."""
        order: list[IntArray] = []
        for g in groups:
            part = support[g.start : g.stop]
            if int(np.count_nonzero(part)) != g.budget or not 0 < g.budget < len(part):
                return None
            order += [np.flatnonzero(part) + g.start, np.flatnonzero(~part) + g.start]
        return cls.listed(order)

    @classmethod
    def among(cls, chosen: BoolArray, of: BoolArray, groups: Sequence[Group]) -> "Largest":
        """Test for the chosen columns among `of` only, in groups where there are chosen and other
        ones."""
        order: list[IntArray] = []
        for g in groups:
            part, some = chosen[g.start : g.stop], of[g.start : g.stop]
            sides = [np.flatnonzero(side & some) + g.start for side in (part, ~part)]
            if all(len(side) for side in sides):
                order += sides
        return cls.listed(order)

    def holds(self, sizes: FloatArray, tolerance: Tolerance) -> bool:
        """True if the active entries of each group are certainly larger than its others."""
        if not len(self.order):
            return True
        relative, absolute = tolerance
        # the least of the active ones, and the largest of the others times -1
        ends = np.minimum.reduceat(sizes.take(self.order) * self.signs, self.starts).tolist()
        for least, most in zip(ends[::2], ends[1::2], strict=True):
            if not least > absolute - (1.0 + relative) * most:
                return False
        return True


def first(sizes: FloatArray, count: int) -> BoolArray:
    """Mask of the `count` largest entries; of equal entries the first ones."""
    chosen = np.zeros(len(sizes), dtype=np.bool_)
    chosen[np.argsort(-sizes, kind="stable")[:count]] = True
    return chosen


def largest(sizes: FloatArray, count: int, tolerance: Tolerance) -> list[BoolArray]:
    """Masks of the `count` largest entries: one, two where the last entry is uncertain, none if
    more are."""
    if count >= len(sizes):
        return [sizes > 0.0]
    order, chosen = (-sizes).argsort(kind="stable"), np.zeros(len(sizes), dtype=np.bool_)
    chosen[order[:count]] = True
    a, over = sizes[order], tolerance.over
    if count == 0 or a[count - 1] > over(a[count]):
        return [chosen]
    clear_above = count < 2 or a[count - 2] > over(a[count])
    clear_below = count + 1 >= len(a) or a[count - 1] > over(a[count + 1])
    if not (clear_above and clear_below):
        return []
    second = chosen.copy()
    second[order[count - 1]], second[order[count]] = False, True
    return [chosen, second]


def within_reach(sizes: FloatArray, count: int, tolerance: Tolerance) -> BoolArray:
    """Mask of all entries that may be among the `count` largest, within the tolerance."""
    if not 0 < count < len(sizes):
        return np.asarray(sizes > 0.0) if count else np.zeros(len(sizes), dtype=np.bool_)
    last = float(np.partition(sizes, len(sizes) - count)[len(sizes) - count])
    return np.asarray((sizes > 0.0) & (
        (1.0 + tolerance.relative) * sizes + tolerance.absolute >= last))


def reach(sizes: FloatArray, groups: Sequence[Group], tolerance: Tolerance) -> BoolArray:
    """Mask (k,) of all columns that may be among the `budget` largest of their group.

    If least squares on all of them fits no better than a support does, no choice among them does.
    """
    return np.concatenate([within_reach(sizes[g.start : g.stop], g.budget or 0, tolerance)
                           for g in groups])


def choices(
    sizes: FloatArray, groups: Sequence[Group], tolerance: Tolerance
) -> list[BoolArray]:
    """Masks (k,) of the `budget` largest of each group: all combinations within the tolerance, none
    if there are many."""
    ways = [largest(sizes[g.start : g.stop], g.budget or 0, tolerance) for g in groups]
    return [np.concatenate(parts) for parts in product(*ways)]


def within(sizes: FloatArray, count: int, tolerance: Tolerance) -> list[BoolArray] | None:
    """Masks of the `count` largest entries among those above zero, as in `largest`; None if
    uncertain."""
    if count >= int(np.count_nonzero(sizes > 0.0)):
        return [sizes > 0.0]
    return largest(sizes, count, tolerance) or None


def apart(sizes: FloatArray, others: FloatArray, count: int) -> float:
    """Largest difference of `sizes` and `others` near the threshold that the `count` largest of
    `sizes` exceed, relative to the threshold."""
    if not 0 < count < len(sizes):
        return 0.0
    threshold = float(np.partition(sizes, len(sizes) - count)[len(sizes) - count])
    near = (sizes > 0.5 * threshold) & (sizes < 2.0 * threshold)
    return float(np.abs(sizes - others)[near].max()) / threshold if near.any() else 0.0
