"""What both samplers share: which rows may be drawn, in whole rows or in whole nodes."""

from collections.abc import Callable
from typing import Literal

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.errors import InputError

Unit = Literal["dof", "node"]
Draw = Callable[[int, int, np.random.Generator], IntArray]
"""(N, m, rng) -> m distinct integers below N."""


def sample_rows(
    draw: Draw,
    coordinates: FloatArray,
    m: int,
    required: IntArray,
    unit: Unit,
    rng: np.random.Generator,
    name: str,
) -> IntArray:
    """`required` and m rows more, sorted. coordinates (n, d): node of each row, m."""
    n = coordinates.shape[0]
    forced = np.unique(np.asarray(required, dtype=np.int64))
    candidates = np.setdiff1d(np.arange(n, dtype=np.int64), forced)
    if not 0 <= m <= candidates.size:
        besides = f" besides the {forced.size} required ones" if forced.size else ""
        raise InputError(
            f"{m} rows were asked of {name}, which has {candidates.size} unknowns to draw from"
            f"{besides}: take between 0 and {candidates.size}",
            "rows",
        )
    if unit == "dof":
        chosen = candidates[draw(candidates.size, m, rng)]
    else:
        chosen = _whole_nodes(draw, coordinates[candidates], m, rng, candidates)
    return np.union1d(forced, chosen)


def _whole_nodes(
    draw: Draw, places: FloatArray, m: int, rng: np.random.Generator, candidates: IntArray
) -> IntArray:
    """m rows on as few nodes as that takes: fewer elements are touched than by single rows.

    Only the last node drawn may give fewer rows than it has.
    """
    _, first, node = np.unique(places, axis=0, return_index=True, return_inverse=True)
    by_row = np.argsort(np.argsort(first))  # number nodes as the rows do, so that strata follow
    node = by_row[node.reshape(-1)]
    sizes = np.bincount(node)
    nodes = draw(sizes.size, -(-m // int(sizes.max(initial=1))), rng)
    order = np.concatenate([nodes, rng.permutation(np.setdiff1d(np.arange(sizes.size), nodes))])
    enough = int(np.searchsorted(np.cumsum(sizes[order]), m)) + 1
    rank = np.full(sizes.size, sizes.size)
    rank[order[:enough]] = np.arange(min(enough, sizes.size))
    return candidates[np.argsort(rank[node], kind="stable")[:m]]
