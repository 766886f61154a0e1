"""Convergence test of a step's iteration: estimated error from consecutive changes, and round-off.

Two full (unaccelerated) changes of one iteration, d then d', estimate the remaining error in each
part of the unknowns: d' q/(1 - q), with q = |d'|/|d| of that part (Deuflhard 2011, doi
10.1007/978-3-642-23899-4, Sec. 2.1). q is bounded below by `LEAST`: a change consists of many
modes, and a fast one may hide a slow one. A change that no longer decreases is accepted as
round-off only if it is below the effect on the unknowns of rounding the terms of the equations.
"""

from dataclasses import dataclass
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
