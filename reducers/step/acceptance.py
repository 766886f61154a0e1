"""Acceptance of a step: error estimated from the changes of its iterations, and round-off.

Two full changes of one iteration, d then d', estimate the error that remains in each part of the
unknowns: d' q/(1 - q), with q = |d'|/|d| of that part (Deuflhard 2011,
doi 10.1007/978-3-642-23899-4, Sec. 2.1). q is not taken below `LEAST`: a change is made of many
modes, and a fast one may hide a slow one. A change that no longer falls is round-off only where it
is below what rounding the terms of the equations makes of the unknowns.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf

import numpy as np

from sparsemor.core import FloatArray

EPS = float(np.finfo(np.float64).eps)
LEAST = 1e-2
"""Smallest ratio of two changes that the estimate of the error relies on."""
TRUSTED = 0.5
"""Largest ratio with which the error that remains is estimated by less than the last change."""
STALLED = 0.25
"""A change that is not below this share of the one before no longer falls."""
MARGIN = 16.0
"""Round-off may be so many times as large as the estimate of its size."""


def estimated_error(change: float, before: float, least: float = LEAST) -> float:
    """Error that remains of one part of the unknowns after two full changes; before: inf where
    there is none to compare with; least: smallest ratio that is relied on."""
    ratio = max(change / before, least) if 0.0 < before < inf else inf
    return change * ratio / (1.0 - ratio) if ratio < TRUSTED else change


def largest_error(changes: Sequence[float], before: Sequence[float] | None) -> float:
    """Of all parts; before: their changes one iteration earlier, None where there are none, or
    where an accelerated change lies between."""
    if before is None:
        return max(changes, default=0.0)
    return max(map(estimated_error, changes, before), default=0.0)


def rounding(n: int) -> FloatArray:
    """(n,) random signs times the unit of rounding, always the same."""
    signs = np.random.default_rng(0).integers(0, 2, n)
    return np.asarray(EPS * (2.0 * signs - 1.0))


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Relative error that may remain in each unknown, and when to give up."""

    remaining: float = 1e-13
    max_iterations: int = 30


@dataclass(slots=True)
class Scales:
    """Sizes that changes are compared with, from the steps so far. Lives in the step memory.

    elastic: largest |u|^2 of each body; floor: |du|^2 of each body that rounding the rigid
    coordinates makes, for coordinates of size 1; acceleration: largest norm of the rigid
    accelerations of a solved step.
    """

    elastic: list[float] = field(default_factory=list)
    floor: list[float] = field(default_factory=list)
    acceleration: float = 0.0

    def copy(self) -> "Scales":
        """Separate lists with the same numbers."""
        return Scales(self.elastic[:], self.floor[:], self.acceleration)
