"""Uniform random sampling of rows without replacement, a baseline for other samplers."""

import numpy as np

from sparsemor.core import BlockData, Dictionary, IntArray
from sparsemor.plugins.samplers.candidate_rows import RowSampler, sample_rows


class Uniform(RowSampler):
    """Uniform random sampling: all sets of m rows (or nodes, `unit: node`) are equally likely."""

    def rows_beside(
        self, kept: IntArray, block: BlockData, m: int, dictionary: Dictionary,
        rng: np.random.Generator,
    ) -> IntArray:
        return sample_rows(without_order, block, m, kept, self.unit, rng)


def without_order(N: int, m: int, rng: np.random.Generator) -> IntArray:
    """Random order of m distinct random integers below N."""
    return rng.choice(N, size=m, replace=False).astype(np.int64)
