"""Notes on the estimated error of a run and on what followed from it."""

from collections.abc import Sequence

import numpy as np

from sparsemor.core.notes import Note, information
from sparsemor.core.protocols import ErrorLimit, EstimatesErrors
from sparsemor.core.results.error_norms import estimated_errors
from sparsemor.core.results.run_result import RunResult


def error_limit(reducer: object) -> ErrorLimit:
    """Tolerance of the estimated error of runs with this reducer, and what follows beyond it."""
    return reducer.error_limit if isinstance(reducer, EstimatesErrors) else ErrorLimit()


def enrichment_notes(times: Sequence[float], steps: int) -> tuple[Note, ...]:
    """Note on atoms that were added at some times, s, from `steps` full-order steps."""
    return () if not times else (information(
        f"atoms were added {len(times)} times, first at {times[0]:.4g} s, because the estimated "
        f"error exceeded its tolerance; {steps} steps of the run were solved at full order",
        "enriched"),)


def large_estimates(result: RunResult, limit: float) -> tuple[Note, ...]:
    """Warnings about blocks whose estimated error exceeds the limit."""
    notes, times = [], result.times
    for name, error in estimated_errors(result).items():
        above = np.flatnonzero(error > limit)
        if len(above):
            notes.append(Note(
                f"the estimated error of {name} reaches {error.max():.2g} of its largest change "
                f"(limit {limit:g}, first above it at {times[above[0]]:.4g} s): train on a run "
                "that covers this one, or take more atoms, more rows or another basis",
                "estimated_error"))
    return tuple(notes)
