"""Time tables: functions of time only, precomputed at the times of a run."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray

NEAR = 1e-9
"""Share of the interval before it by which a time may miss a tabled one: it was summed up
differently."""
Source = Callable[[FloatArray], FloatArray]
"""Times (T,), s -> (T, m)."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeTable:
    """rows (T, m): the source's values at the increasing `times`. At any other time it is asked.
    What it gives must not be written to."""

    source: Source
    times: tuple[float, ...] = ()
    rows: FloatArray | None = None
    near: float = 0.0

    @classmethod
    def of(cls, source: Source, times: FloatArray) -> "TimeTable":
        """`source` at all these times (T,), s."""
        if not len(times):
            return cls(source)
        near = NEAR * float(np.diff(times).min()) if len(times) > 1 else 0.0
        return cls(source, tuple(times.tolist()), source(times), near)

    def at(self, t: float) -> FloatArray:
        """(m,)"""
        if self.rows is not None:
            i = bisect_left(self.times, t - self.near)
            if i < len(self.times) and self.times[i] - t <= self.near:
                return np.asarray(self.rows[i])
        return np.asarray(self.source(np.array([t]))[0])

    def along(self, times: FloatArray) -> FloatArray:
        """(T, m) at times (T,), s; at its own times the rows themselves, not a copy."""
        if self.rows is not None and np.array_equal(times, self.times):
            return self.rows
        return np.array([self.at(t) for t in times.tolist()])
