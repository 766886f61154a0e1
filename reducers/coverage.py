"""Loads and joints that a sample of rows does not see."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core import AssembledModel, IntArray, Note

UNSAMPLED = "unsampled"
"""Kind of these notes."""
KEEP = "keep the required rows (sampler.required: true) or sample more rows"


def unsampled_loads(
    model: AssembledModel, rows: Mapping[str, IntArray], hint: str = KEEP
) -> tuple[Note, ...]:
    """A note for each load or joint none of whose rows is in the sample of a block."""
    return tuple(
        Note(f"no sampled row of {block} is one that {name} acts on: it has no effect there; "
             f"{hint}", UNSAMPLED)
        for block, chosen_rows in rows.items()
        for name, touched in model.loaded[block].items()
        if not np.isin(touched, chosen_rows).any())
