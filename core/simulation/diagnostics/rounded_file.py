"""Rounding of the large matrices in the file of a kept model, and what it changes.

Rounding an entry to 1e-9 of the largest of its row need not change a run by 1e-9: the columns of a
matrix may have different units, so that small entries multiply large numbers. So the change is
measured in a run, before a file is written.
"""

from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.notes import Note, information
from sparsemor.core.results.run_result import RunResult

LARGE_FILE = 5_000_000
"""Bytes of a file above which its large matrices are rounded by default."""
ENOUGH = 1e-9
"""What they are then rounded to, relative to the largest entry of each row."""
HARMLESS = 1e-6
"""Largest change of a run by rounding that is no reason for a warning."""
ROUNDED = "rounded"
"""Kind of the note on it."""
TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True)
class SavedModel:
    """File of a model: rounding of its large matrices, relative to the largest entry of each row (0
    for none), and by how much that changes the unknowns of a run, relative to the largest of each
    block (`inf` where the run fails)."""

    rounded: float
    change: float

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes of runs of the file."""
        if not self.rounded:
            return ()
        text = (f"the file of the model rounds large matrices to {self.rounded:g} of the largest "
                f"entry of each row, which changed its own run by {self.change:.1e} of the largest "
                "unknown of a block")
        return (information(text, ROUNDED) if self.change <= HARMLESS else Note(
            f"{text}: save it with rounded=0 (--rounded 0)", ROUNDED),)


def largest_difference(one: RunResult, other: RunResult) -> float:
    """Largest difference of an unknown of two runs of the same steps, relative to the largest of
    its block in the first."""
    return max((_difference(_unknowns(one, b.name), _unknowns(other, b.name))
                for b in one.layout), default=0.0)


def _unknowns(run: RunResult, name: str) -> FloatArray:
    return run.coefficients(name) if run.reduced(name) else run.block(name)


def _difference(one: FloatArray, other: FloatArray) -> float:
    apart = float(np.abs(one - other).max(initial=0.0))
    return apart / max(float(np.abs(one).max()), TINY) if apart else 0.0
