"""Functions of time only: loads of an instant, and tables of values at the times of a run."""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sparsemor.core import (
    Amplitude,
    FloatArray,
    Table,
    Tabled,
    amplitudes_along,
    evaluate_amplitudes,
    total_load,
    total_load_along,
)

NEAR = 1e-9
"""Share of the interval before it by which a time may miss a tabled one: it was summed up
differently."""
Source = Callable[[FloatArray], FloatArray]
"""Times (T,), s -> (T, m)."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeTable:
    """Function of time with tabulated values: rows (T, m) at the increasing `times`; at any other
    time the source is evaluated. Values must not be written to."""

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


class Loaded(Protocol):
    """Rows (n,) with loads that time alone decides: loads (n, j) times amplitudes, and tables."""

    @property
    def loads(self) -> FloatArray: ...
    @property
    def amplitudes(self) -> Sequence[Amplitude]: ...
    @property
    def tables(self) -> Sequence[Tabled]: ...


def plus_loads(r: FloatArray, rows: Loaded, t: float, sign: float = 1.0) -> FloatArray:
    """r (n,) plus sign times the loads at t, s."""
    if rows.amplitudes:
        r = r + sign * (rows.loads @ evaluate_amplitudes(rows.amplitudes, t))
    return np.asarray(r + sign * total_load(rows.tables, t) if rows.tables else r)


@dataclass(frozen=True, slots=True, eq=False)
class TabulatedLoads:
    """left (s, m) @ table.at(t), for tables (T, m) of tested rows."""

    table: Table
    left: FloatArray

    def at(self, t: float) -> FloatArray:
        """(s,)"""
        return np.asarray(self.left.dot(self.table.at(t)))

    def along(self, times: FloatArray) -> FloatArray:
        """(T, s)"""
        return np.asarray(self.table.along(times).dot(self.left.T))


Moving = Table | TabulatedLoads
"""What has a value (s,) `at` each time."""


def tabulated(tables: Sequence[Table], left: FloatArray, for_good: bool) -> tuple[Moving, ...]:
    """Applied to all times at once where the arrays stay for the whole run; a support that may
    change with the next step does not pay for that."""
    return tuple(t.through(left) if for_good else TabulatedLoads(t, left) for t in tables)


def along(
    base: FloatArray, loads: FloatArray, amplitudes: Sequence[Amplitude],
    tables: Sequence[Moving], times: FloatArray,
) -> FloatArray:
    """(T, s) base, (s,) or (T, s), plus loads (s, j) times amplitudes, and tables, at times (T,).
    """
    rows = np.zeros((len(times), base.shape[-1])) + base
    if amplitudes:
        rows += amplitudes_along(amplitudes, times).dot(loads.T)
    if tables:
        rows += total_load_along(tables, times)
    return rows
