"""What time alone decides, evaluated ahead at the times at which a run is going to ask for it."""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray

NEAR = 1e-9
"""Share of the interval before it by which a time may miss a tabled one: it was summed up
differently."""


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """source: time (s) -> (m,); rows (T, m): its values at the increasing `times`. At any other
    time it is asked. What it gives must not be written to."""

    source: Callable[[float], FloatArray]
    times: tuple[float, ...] = ()
    rows: FloatArray | None = None
    near: float = 0.0

    @classmethod
    def of(cls, source: Callable[[float], FloatArray], times: FloatArray) -> "Known":
        """`source` at all these times (T,), s."""
        if not len(times):
            return cls(source)
        near = NEAR * float(np.diff(times).min()) if len(times) > 1 else 0.0
        given = times.tolist()
        return cls(source, tuple(given), np.stack([source(t) for t in given]), near)

    def at(self, t: float) -> FloatArray:
        """(m,)"""
        if self.rows is not None:
            i = bisect_left(self.times, t - self.near)
            if i < len(self.times) and self.times[i] - t <= self.near:
                return np.asarray(self.rows[i])
        return self.source(t)
