"""Convergence test of a step's iteration: estimated error from consecutive changes, and round-off.

Two full (unaccelerated) changes of one iteration, d then d', estimate the remaining error in each
part of the unknowns: d' q/(1 - q), with q = |d'|/|d| of that part (Deuflhard 2011, doi
10.1007/978-3-642-23899-4, Sec. 2.1). q is bounded below by `LEAST`: a change consists of many
modes, and a fast one may hide a slow one. A change that no longer decreases is accepted as
round-off only if it is below the effect on the unknowns of rounding the terms of the equations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from math import inf

import numpy as np

from sparsemor.core import FloatArray

EPS = float(np.finfo(np.float64).eps)
LEAST = 1e-2
"""Lower bound of the ratio of two changes in the error estimate."""
TRUSTED = 0.5
"""Largest ratio of two changes for which the error is estimated by less than the last change."""
STALLED = 0.25
"""Ratio to the previous change from which a change counts as no longer decreasing."""
MARGIN = 16.0
"""Safety factor of the estimated round-off."""
NEGLIGIBLE = 0.1
"""Part of the estimated round-off below which a change counts as zero."""


def estimated_error(change: float, before: float, least: float = LEAST) -> float:
    """Estimated error of one part of the unknowns after two full changes; before: the previous
    change, inf where there is none; least: lower bound of the ratio."""
    ratio = max(change / before, least) if 0.0 < before < inf else inf
    return change * ratio / (1.0 - ratio) if ratio < TRUSTED else change


def largest_error(changes: Sequence[float], before: Sequence[float] | None) -> float:
    """Largest estimated error of all parts of the unknowns; before: their changes one iteration
    earlier, None where there are none or where the previous change was accelerated."""
    if before is None:
        return max(changes, default=0.0)
    return max(map(estimated_error, changes, before), default=0.0)


@cache
def rounding(n: int) -> FloatArray:
    """Vector (n,) of the unit round-off with random signs, the same in every call; not to be
    changed."""
    signs = np.random.default_rng(0).integers(0, 2, n)
    return np.asarray(EPS * (2.0 * signs - 1.0))


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Relative error tolerance of each unknown in a step, and largest number of iterations."""

    remaining: float = 1e-13
    max_iterations: int = 30


ACCELERATION_ERROR = 1e3
"""Tolerance of the relative error of accelerations, as a multiple of `remaining`."""


def reference(size: float, acceleration: float, c2: float, remaining: float) -> float:
    """Reference magnitude of changes of unknowns of this size: the size itself, or less where an
    error of `remaining` times it would dominate the accelerations c2 x, but not below round-off."""
    return min(size, max(ACCELERATION_ERROR * acceleration / c2, 4 * EPS * size / remaining))


@dataclass(slots=True)
class Scales:
    """Reference magnitudes of the changes, from the steps so far; part of the state between steps.

    elastic, bending: largest |u|^2 and |u''|^2 of each body; floor: |du|^2 of each body due to
    rounding of rigid
    coordinates of size 1; acceleration: largest norm of the rigid accelerations of a solved step.
    """

    elastic: list[float] = field(default_factory=list)
    bending: list[float] = field(default_factory=list)
    floor: list[float] = field(default_factory=list)
    acceleration: float = 0.0

    def copy(self) -> "Scales":
        """Independent copy."""
        return Scales(self.elastic[:], self.bending[:], self.floor[:], self.acceleration)
