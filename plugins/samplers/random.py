"""Rows drawn uniformly without replacement: the plainest sampler to compare others with."""

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.protocols import BlockData, Dictionary
from sparsemor.plugins.samplers.candidates import sample_rows
from sparsemor.plugins.samplers.row_sampler import RowSampler


class Uniform(RowSampler):
    """Every set of m candidate rows is equally likely (of nodes, with `unit: node`)."""

    def rows_beside(
        self, kept: IntArray, block: BlockData, m: int, dictionary: Dictionary,
        rng: np.random.Generator,
    ) -> IntArray:
        return sample_rows(without_order, block, m, kept, self.unit, rng)


def without_order(N: int, m: int, rng: np.random.Generator) -> IntArray:
    """m distinct integers below N, in random order."""
    return rng.choice(N, size=m, replace=False).astype(np.int64)
