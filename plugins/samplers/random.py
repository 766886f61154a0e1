"""Rows drawn uniformly without replacement: the plainest sampler to compare others with."""

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import BlockData, Dictionary
from sparsemor.plugins.samplers.candidates import Required, Unit, kept_rows, sample_rows


class Uniform(Plugin):
    """Every set of m candidate rows is equally likely (of nodes, with `unit: node`)."""

    required: Required = True
    """Force the rows that carry joints and localized loads; `ring`: and those of all elements along
    the path of loads that move. False draws or misses them like any other."""
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
        return sample_rows(without_order, block.coordinates, m, forced, self.unit, rng, block.name)


def without_order(N: int, m: int, rng: np.random.Generator) -> IntArray:
    """m distinct integers below N, in random order."""
    return rng.choice(N, size=m, replace=False).astype(np.int64)
