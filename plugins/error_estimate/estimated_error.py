"""Estimated error of a reduced run beyond its tolerance."""

import numpy as np

from sparsemor.core import Check, Findings, Note, PreparedRun, RunResult
from sparsemor.core.results.relative_error_estimates import estimated_errors
from sparsemor.plugins.checks import place


class EstimatedError(Check):
    """Estimated error that exceeds its tolerance."""

    order = place("estimated_error")

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        return Findings(large_estimates(result, run.error_limit.tolerance))


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
