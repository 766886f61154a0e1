"""The largest entries of a vector, and whether they are surely the largest."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from sparsemor.core import BoolArray, FloatArray, Group, IntArray


class Tolerance(NamedTuple):
    """By how much one entry has to exceed another to be surely the larger one."""

    relative: float
    absolute: float = 0.0

    def over(self, size: float) -> float:
        """Norms certain to exceed `size`."""
        return (1.0 + self.relative) * size + self.absolute


class Sizes(NamedTuple):
    """(k,) sizes of coefficients as they are compared, and how close is too close."""

    sizes: FloatArray
    close: Tolerance


@dataclass(frozen=True, slots=True, eq=False)
class Largest:
    """`order` lists each group's active columns, then its other ones; `starts` where each list
    begins; signs: 1 for active ones, -1 for others."""

    order: IntArray
    starts: IntArray
    signs: FloatArray

    @classmethod
    def listed(cls, sides: Sequence[IntArray]) -> "Largest":
        """Active columns, other columns, active ones of the next group, and so on."""
        lengths = [len(side) for side in sides]
        signs = np.repeat(np.resize([1.0, -1.0], len(lengths)), lengths)
        return cls(np.concatenate([np.zeros(0, np.int64), *sides]),
                   np.cumsum([0, *lengths[:-1]]), signs)

    @classmethod
    def of(cls, support: BoolArray, groups: Sequence[Group]) -> "Largest | None":
        """None for a support that does not use up every budget, or leaves no one out."""
        order: list[IntArray] = []
        for g in groups:
            part = support[g.start : g.stop]
            if int(np.count_nonzero(part)) != g.budget or not 0 < g.budget < len(part):
                return None
            order += [np.flatnonzero(part) + g.start, np.flatnonzero(~part) + g.start]
        return cls.listed(order)

    @classmethod
    def among(cls, chosen: BoolArray, of: BoolArray, groups: Sequence[Group]) -> "Largest":
        """The same for the chosen ones among `of` only, in groups that leave someone out."""
        order: list[IntArray] = []
        for g in groups:
            part, some = chosen[g.start : g.stop], of[g.start : g.stop]
            sides = [np.flatnonzero(side & some) + g.start for side in (part, ~part)]
            if all(len(side) for side in sides):
                order += sides
        return cls.listed(order)

    def holds(self, sizes: FloatArray, tolerance: Tolerance) -> bool:
        """Are the active entries of each group surely larger than its others?"""
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
    """The `count` largest entries; of equal ones those in front."""
    chosen = np.zeros(len(sizes), dtype=np.bool_)
    chosen[np.argsort(-sizes, kind="stable")[:count]] = True
    return chosen


def largest(sizes: FloatArray, count: int, tolerance: Tolerance) -> list[BoolArray]:
    """The `count` largest entries: one way, two where the last one is unsure, none if more."""
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
    """All entries that may be among the `count` largest."""
    if not 0 < count < len(sizes):
        return np.asarray(sizes > 0.0) if count else np.zeros(len(sizes), dtype=np.bool_)
    last = float(np.partition(sizes, len(sizes) - count)[len(sizes) - count])
    return np.asarray((sizes > 0.0) & (
        (1.0 + tolerance.relative) * sizes + tolerance.absolute >= last))


def reach(sizes: FloatArray, groups: Sequence[Group], tolerance: Tolerance) -> BoolArray:
    """The same for each group, as many as it has room for. If all of them together fit no better
    than a support, no choice of them does."""
    return np.concatenate([within_reach(sizes[g.start : g.stop], g.budget or 0, tolerance)
                           for g in groups])


def choices(
    sizes: FloatArray, groups: Sequence[Group], tolerance: Tolerance
) -> list[BoolArray]:
    """The `budget` largest of each group: all ways that may be meant, none if there are many."""
    ways = [largest(sizes[g.start : g.stop], g.budget or 0, tolerance) for g in groups]
    return [np.concatenate(parts) for parts in product(*ways)]


def within(sizes: FloatArray, count: int, tolerance: Tolerance) -> list[BoolArray] | None:
    """The same of the entries above zero; None if unsure."""
    if count >= int(np.count_nonzero(sizes > 0.0)):
        return [sizes > 0.0]
    return largest(sizes, count, tolerance) or None


def apart(sizes: FloatArray, others: FloatArray, count: int) -> float:
    """Largest difference near the threshold that the `count` largest of `sizes` pass, over it."""
    if not 0 < count < len(sizes):
        return 0.0
    threshold = float(np.partition(sizes, len(sizes) - count)[len(sizes) - count])
    near = (sizes > 0.5 * threshold) & (sizes < 2.0 * threshold)
    return float(np.abs(sizes - others)[near].max()) / threshold if near.any() else 0.0
