"""States at which the errors of a reduced block are tested before its run."""

from sparsemor.core import (
    AssembledModel,
    BlockData,
    FloatArray,
    OfflineProducts,
    SolveFailed,
    StepFactors,
)
from sparsemor.core.model.expected_states import expected_states


def states_to_test(
    model: AssembledModel, offline: OfflineProducts, data: BlockData, step: StepFactors, end: float
) -> FloatArray | None:
    """States (n, M) of one block: its training snapshots, or estimates of a run up to `end` (s)
    where there was no training; None where these cannot be computed."""
    if offline.trained:
        return offline.snapshots(data.name)
    try:
        return expected_states(model, data.name, step, end).states
    except SolveFailed:  # the run itself will say so
        return None
