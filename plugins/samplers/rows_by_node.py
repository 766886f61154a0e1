"""Candidate rows of samplers, as single rows or as whole nodes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sparsemor.core import BlockData, BoolArray, FloatArray, InputError, IntArray

Unit = Literal["dof", "node"]
Required = bool | Literal["ring"]
"""Rows that are always kept. False: none; True: those that joints and localized loads act on;
`ring`: also those of elements along the path of moving loads."""
Draw = Callable[[int, int, np.random.Generator], IntArray]
"""Function of (N, m, rng) that returns m distinct integers below N."""


def kept_rows(option: Required, block: BlockData, required: IntArray) -> IntArray:
    """Rows that a sampler with this option always keeps, sorted; required: rows that joints and
    localized loads act on."""
    if option == "ring":
        return np.union1d(required, block.ring)
    return required if option else required[:0]


def free_rows(n: int, m: int, required: IntArray, name: str) -> BoolArray:
    """Mask (n,), True for the rows that are not required. Raises InputError when m exceeds their
    number; name: of the block."""
    free = ~np.isin(np.arange(n), required)
    left = int(free.sum())
    if not 0 <= m <= left:
        more = f" in addition to the {n - left} required ones" if left < n else ""
        raise InputError(
            f"{m} rows were requested of {name}, which has {left} unknowns to draw from"
            f"{more}: take between 0 and {left}",
            "rows",
        )
    return free


def sample_rows(
    draw: Draw, block: BlockData, m: int, kept: IntArray, unit: Unit, rng: np.random.Generator
) -> IntArray:
    """Sorted rows: those in `kept` and m more, selected by `draw`."""
    free = free_rows(block.size, m, kept, block.name)
    candidates = np.flatnonzero(free)
    if unit == "dof":
        chosen = candidates[draw(candidates.size, m, rng)]
    else:
        chosen = candidates[_whole_nodes(draw, block.coordinates[candidates], m, rng)]
    return np.union1d(np.flatnonzero(~free), chosen)


def _whole_nodes(
    draw: Draw, coordinates: FloatArray, m: int, rng: np.random.Generator
) -> IntArray:
    """Positions of m rows on as few nodes as possible: fewer elements are evaluated than by single
    rows.

    Only the last node drawn may contribute fewer rows than it has.
    """
    node = node_numbers(coordinates)
    sizes = np.bincount(node)
    nodes = draw(sizes.size, -(-m // int(sizes.max(initial=1))), rng)
    order = np.concatenate([nodes, rng.permutation(np.setdiff1d(np.arange(sizes.size), nodes))])
    return in_order(node, order, m)


def node_numbers(coordinates: FloatArray) -> IntArray:
    """Node number of each row, in the order of first occurrence, so that strata of nodes follow the
    rows."""
    _, first, node = np.unique(coordinates, axis=0, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[node.reshape(-1)]


def in_order(node: IntArray, order: IntArray, m: int) -> IntArray:
    """Positions of m rows in `node`, the node number of each row: whole nodes in the given order,
    the last one perhaps in part."""
    rank = np.empty(order.size, dtype=np.int64)
    rank[order] = np.arange(order.size)
    return np.argsort(rank[node], kind="stable")[:m]


@dataclass(slots=True, eq=False)
class GreedyRows:
    """Greedy selection of the rows of one block by scores, which may change after each selection.

    taken (n,): mask of the rows selected so far, initially the required ones; node (n,): rows with
    the same number are taken together; left: number of rows still to be taken.
    """

    taken: BoolArray
    node: IntArray
    left: int

    @classmethod
    def of(cls, coordinates: FloatArray, free: BoolArray, m: int, unit: Unit) -> "GreedyRows":
        node = np.arange(free.size) if unit == "dof" else node_numbers(coordinates)
        return cls(~free, node, m)

    def take(self, score: FloatArray) -> IntArray:
        """Takes the free row with the largest score (n,), with the others of its node while rows
        are left; returns their numbers."""
        open_score = np.where(self.taken, -np.inf, score)
        node = self.node[open_score.argmax()]
        mates = np.flatnonzero((self.node == node) & ~self.taken)
        best = mates[np.argsort(-open_score[mates], kind="stable")][: self.left]
        self.taken[best] = True
        self.left -= best.size
        return best

    def take_in_order(self, key: FloatArray) -> None:
        """Takes all rows that are left, whole nodes by increasing key (number of nodes,)."""
        free = np.flatnonzero(~self.taken)
        order = np.argsort(key, kind="stable")
        self.taken[free[in_order(self.node[free], order, self.left)]] = True
        self.left = 0

    def numbers(self) -> IntArray:
        """Rows taken so far, sorted."""
        return np.flatnonzero(self.taken)
