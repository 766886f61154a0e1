"""Loads and joints that a sample of rows does not see."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core.arrays import IntArray
from sparsemor.core.model import Model
from sparsemor.core.notes import Note

UNSAMPLED = "unsampled"
"""Kind of these notes."""
KEEP = "keep the required rows (sampler.required: true) or take more rows"


def missed_loads(
    model: Model, rows: Mapping[str, IntArray], hint: str = KEEP
) -> tuple[Note, ...]:
    """A note for each load or joint none of whose rows is in the sample of a block."""
    return tuple(
        Note(f"the sampled rows of {block} miss {name}: the model does not feel it there; {hint}",
             UNSAMPLED)
        for block, chosen_rows in rows.items()
        for name, touched in model.loaded[block].items()
        if not np.isin(touched, chosen_rows).any())
