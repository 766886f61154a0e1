"""Check of functions of time for jumps and pulses that the time steps do not resolve.

An integrator evaluates loads at its steps t_n only. The impulse that acts is then the sum of h
f(t_n), or for functions that are not zero at the start the trapezoidal sum, and not the integral of
f. Both agree for functions that change slowly, but not for a pulse of a few steps. The integral is
exact between the characteristic times of the function, which are among the numbers of its options;
a function that jumps at other times is not found.
"""

from collections.abc import Iterator, Mapping

import numpy as np
from pydantic import BaseModel

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.notes import Note
from sparsemor.core.protocols import TimeFunction

LIMIT = 0.1
"""Difference between integral and sum, relative to the integral of |f|, without a warning."""
FEW = 30
"""Number of numbers in a function's options up to which their sums in pairs, such as the end of a
pulse, are characteristic times, too."""
MANY = 1000
"""Largest number of characteristic times that are examined."""
UNRESOLVED = "unresolved_jump"
"""Identifier of the warning."""
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@np.errstate(all="ignore")  # huge numbers are no times
def unresolved_jump(key: str, function: TimeFunction, count: int, h: float) -> Note | None:
    """Warning about a function whose integral over `count` steps of h (s) differs from the sum of
    its values at the steps, because it jumps. key: its key in the scene."""
    t = np.cumsum([0.0, *[h] * count])  # as a run adds its steps
    times = _breaks(function, float(t[-1]))
    steps = _steps_at(times, t)
    if not len(steps):
        return None
    exact = absolute = right = trapezoid = 0.0
    for n in steps:
        before, after = float(t[n - 1]), float(t[n])
        inside = times[(times > before) & (times < after)]
        one, size = _integrals(function, np.array([before, *inside, after]))
        f0, f1 = function.value(before), function.value(after)
        exact, absolute = exact + one, absolute + size
        right, trapezoid = right + h * f1, trapezoid + 0.5 * h * (f0 + f1)
    error = min(right - exact, trapezoid - exact, key=abs)
    if abs(error) <= LIMIT * absolute:  # the integral over the run is larger still
        return None
    smooth = np.ones(count + 1, dtype=np.bool_)
    smooth[[0, *steps]] = False
    values = h * np.array([function.value(float(s)) for s in t[smooth]])
    whole = absolute + float(np.abs(values).sum())
    share = abs(error) / whole if whole > 0.0 else 1.0
    if not share > LIMIT:
        return None
    integral = exact + float(values.sum())
    return Note(
        f"{key} changes within steps of {h:g} s: its integral over the run is {integral:.4g}, and "
        f"the sum of its values at the steps, times the step, {integral + error:.4g}; take "
        f"time.step of at most {h * LIMIT / share:.2g} s, or let it change over several steps",
        UNRESOLVED)


def numbers_in(function: TimeFunction) -> Iterator[float]:
    """Nonnegative numbers in a function's options: its characteristic times are among them. Those
    of the terms of a sum are not: the terms are checked on their own."""
    pending: list[object] = [dict(function)] if isinstance(function, BaseModel) else []
    while pending:
        value = pending.pop()
        if isinstance(value, int | float) and np.isfinite(value) and value >= 0.0:
            yield float(value)
        elif isinstance(value, Mapping):
            pending += value.values()
        elif isinstance(value, list | tuple):
            pending += value


def _breaks(function: TimeFunction, end: float) -> FloatArray:
    """Characteristic times of a function between 0 and `end`, s; none if there are too many."""
    numbers = np.unique([n for n in numbers_in(function) if n < end])
    if len(numbers) <= FEW:
        numbers = np.unique([*numbers, *(numbers[:, None] + numbers).ravel()])
    found = numbers[(numbers > 0.0) & (numbers < end)]
    return found if len(found) <= MANY else np.zeros(0)


def _steps_at(times: FloatArray, t: FloatArray) -> IntArray:
    """Numbers n of the steps with one of the times in the closed interval [t_(n-1), t_n]."""
    steps = np.unique([np.searchsorted(t, times, side) for side in ("left", "right")])
    return steps[(steps > 0) & (steps < len(t))]


def _integrals(function: TimeFunction, edges: FloatArray) -> tuple[float, float]:
    """Integrals of a function and of its absolute value, by 3 Gauss points in each interval between
    the edges."""
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    values = np.array([[function.value(float(s)) for s in m + r * _POINTS]
                       for m, r in zip(middle, half, strict=True)])
    weights = half[:, None] * _WEIGHTS
    return float((weights * values).sum()), float((weights * np.abs(values)).sum())
