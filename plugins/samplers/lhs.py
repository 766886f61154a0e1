"""Latin hypercube sampling of rows: one random row from each of m equal strata (Liang et al. 2026,
Sec. 3.1)."""

import numpy as np

from sparsemor.core import BlockData, Dictionary, IntArray
from sparsemor.plugins.samplers.candidate_rows import RowSampler, sample_rows


class LatinHypercube(RowSampler):
    """Latin hypercube sampling (one-dimensional): one row from each stratum of the row numbers."""

    def rows_beside(
        self, kept: IntArray, block: BlockData, m: int, dictionary: Dictionary,
        rng: np.random.Generator,
    ) -> IntArray:
        return sample_rows(one_per_stratum, block, m, kept, self.unit, rng)


def one_per_stratum(N: int, m: int, rng: np.random.Generator) -> IntArray:
    """Increasing random integers below N, m of them: the i-th from [i N/m, (i+1) N/m), edges
    rounded down."""
    edges = np.arange(m + 1) * N // max(m, 1)
    return rng.integers(edges[:-1], edges[1:]).astype(np.int64)
