"""A sampler in a package of its own: all that a third party has to write."""

import numpy as np
from pydantic import Field

from sparsemor.core.arrays import IntArray
from sparsemor.core.errors import InputError
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import BlockData, Dictionary


class EveryNth(Plugin):
    """Rows at equal distances in the order of the unknowns."""

    start: int = Field(default=0, ge=0)
    """First row, counted among those that are not required."""

    def sample(
        self, block: BlockData, m: int, dictionary: Dictionary, rng: np.random.Generator,
        required: IntArray,
    ) -> IntArray:
        free = np.setdiff1d(np.arange(block.size), required)
        if m > free.size:
            raise InputError(f"{m} rows of {block.name} are wanted, only {free.size} are left")
        picked = (self.start + np.arange(m) * free.size // max(m, 1)) % max(free.size, 1)
        return np.union1d(required, free[picked])
