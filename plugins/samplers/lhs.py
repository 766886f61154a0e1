"""Latin hypercube sampling of rows (Sec. 3.1): one random row from each of m equal strata."""

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import BlockData, Dictionary
from sparsemor.plugins.samplers.candidates import Required, Unit, kept_rows, sample_rows


class LatinHypercube(Plugin):
    """Stratifies the candidate rows in the order of their numbers (a 1-D Latin hypercube)."""

    required: Required = True
    """Force the rows that carry joints and localized loads; `ring`: and those of all elements along
    the path of loads that move. False is the published variant: those rows are drawn or missed
    like any other, and the run may be unstable."""
    unit: Unit = "dof"
    """`dof` draws single rows; `node` draws nodes and takes their rows together."""

    def sample(
        self,
        block: BlockData,
        m: int,
        dictionary: Dictionary,
        rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        """Sorted distinct rows: the required ones and m more. InputError when there are fewer."""
        forced = kept_rows(self.required, block, required)
        return sample_rows(
            one_per_stratum, block.coordinates, m, forced, self.unit, rng, block.name
        )


def one_per_stratum(N: int, m: int, rng: np.random.Generator) -> IntArray:
    """m increasing integers below N, the i-th from [i N/m, (i+1) N/m) rounded down."""
    edges = np.arange(m + 1) * N // max(m, 1)
    return rng.integers(edges[:-1], edges[1:]).astype(np.int64)
