"""Errors of a reduced block at known states before its run."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sparsemor.core import (
    AssembledModel,
    BlockData,
    FloatArray,
    OfflineProducts,
    SolveFailed,
    StepFactors,
)
from sparsemor.core.model.expected_states import expected_states
from sparsemor.core.results.relative_error_estimates import CONSTANT_CHANGE

LIMIT = 0.01
"""Largest relative error at known states without a note."""
STATES, ENTRIES = 400, 2**22
"""Largest number of states, and of their entries in memory unless there are few states."""
FEWEST = 8
"""Smallest number of states to which they are limited."""


class StateError(NamedTuple):
    """Largest errors at states of a block relative to their largest change. solved: of the states
    that the reduced equations return for their forces; best: of their orthogonal projection on the
    atoms."""

    solved: float
    best: float

    @property
    def inaccurate(self) -> bool:
        """True for an error above the limit that is more than twice the projection error."""
        return self.solved > max(LIMIT, 2.0 * self.best)


def largest_change(states: FloatArray) -> float:
    """Largest change of states (n, M) since the first one; 0 for constant states."""
    change = float(np.linalg.norm(states - states[:, :1], axis=0).max())
    constant = change <= CONSTANT_CHANGE * float(np.linalg.norm(states, axis=0).max())
    return 0.0 if constant else change


def error_at_states(
    model: AssembledModel, offline: OfflineProducts, data: BlockData, step: StepFactors,
    kind: str, depends: tuple[object, ...], error: Callable[[FloatArray], StateError | None],
    most: int = STATES,
) -> StateError | None:
    """Error of a block, a function of its states (n, M), at `most` training snapshots, or estimates
    of the states where there was no training, fewer of large blocks; cached as `kind`, by what it
    `depends` on. None without states, for snapshots that the caller supplied (no `recording`), or
    where it is undefined for the states (cached as an empty array)."""
    if offline.recording is None:
        return None
    end = max(offline.recording.end, step.h)

    def make() -> dict[str, FloatArray]:
        states = states_to_test(model, offline, data, step, end)
        if states is None:
            return {"error": np.zeros(0)}
        count = min(most, max(FEWEST, ENTRIES // data.size))
        at = np.unique(np.linspace(0, states.shape[1] - 1, count).astype(np.int64))
        found = error(np.asarray(states[:, at]))
        return {"error": np.zeros(0) if found is None else np.array(found)}

    stored = offline.remember(kind, (*depends, offline.trained, end), make)["error"]
    return StateError(*stored.tolist()) if len(stored) else None


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
