"""Functions of time: loads at one time, and values tabulated at the times of a run."""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from scipy.sparse import issparse

from sparsemor.core import Amplitude, Csr, FloatArray, IntArray, Table
from sparsemor.core.protocols.load_tables import LoadTable, times_rows
from sparsemor.core.protocols.separable import amplitudes_along, evaluate_amplitudes
from sparsemor.core.protocols.time_function import held_reads

NEAR = 1e-9
"""Tolerance of the comparison of a time with tabulated ones, as a fraction of the smallest
interval: times are sums with different rounding."""
Source = Callable[[FloatArray], FloatArray]
"""Function of times (T,), s, with values (T, m)."""


@dataclass(frozen=True, slots=True, eq=False)
class TimeTable:
    """Function of time with tabulated values: rows (T, m) at the increasing `times`, s; at any
    other time `source` is evaluated. near: tolerance of a tabulated time, s. Returned values are
    shared and must not be modified. Values that depend on held functions (inputs that are set from
    step to step) are not kept: `held_reads` grows where one was read."""

    source: Source
    times: tuple[float, ...] = ()
    rows: FloatArray | None = None
    near: float = 0.0
    single: Callable[[float], FloatArray] | None = None
    """The same function at one time, where that is cheaper."""
    last: list[tuple[float, FloatArray]] = field(default_factory=list, compare=False)
    """The last time that is not in the table, and the values there."""

    @classmethod
    def tabulate(
        cls, source: Source, times: FloatArray,
        single: Callable[[float], FloatArray] | None = None,
    ) -> "TimeTable":
        """Table of `source` at the times (T,), s; without values where there are no times, or where
        the source read a held function, an input that may change from step to step."""
        if not len(times):
            return cls(source, single=single)
        near = NEAR * float(np.diff(times).min()) if len(times) > 1 else 0.0
        reads, rows = held_reads(), source(times)
        if held_reads() != reads:
            return cls(source, single=single)
        return cls(source, tuple(times.tolist()), rows, near, single)

    def columns(self, chosen: IntArray) -> "TimeTable":
        """The values with numbers `chosen` (l,), read from this table."""
        return TimeTable(lambda times: self.along(times)[:, chosen],
                         single=lambda t: self.at(t)[chosen])

    def parts(self) -> tuple[Any, ...]:
        return self.source, np.array(self.times), self.single

    @classmethod
    def of_parts(cls, *parts: Any) -> "TimeTable":
        return cls.tabulate(*parts)

    def at(self, t: float) -> FloatArray:
        """Values (m,) at time t, s: a row of the table, the last value computed, or a new one,
        which is kept unless it depends on a held function. near: tolerance of tabulated times, s;
        single: cheaper form of `source` for one time, None if there is none."""
        if self.rows is not None:
            i = bisect_left(self.times, t - self.near)
            if i < len(self.times) and self.times[i] - t <= self.near:
                return np.asarray(self.rows[i])
        if self.last and self.last[0][0] == t:
            return self.last[0][1]
        reads, values = held_reads(), (np.asarray(self.source(np.array([t]))[0])
                                       if self.single is None else self.single(t))
        if held_reads() == reads:
            self.last[:] = [(t, values)]
        return values

    def along(self, times: FloatArray) -> FloatArray:
        """Values (T, m) at times (T,), s; at the tabulated times the rows themselves, not a
        copy."""
        if self.rows is not None:
            known = np.array(self.times)
            if np.array_equal(times, known):
                return self.rows
            i = np.minimum(np.searchsorted(known, times - self.near), len(known) - 1)
            if (np.abs(known[i] - times) <= self.near).all():
                return np.asarray(self.rows[i])
        return np.array([self.at(t) for t in times.tolist()])


class Tabled(Protocol):
    """Values at a time t, s."""

    def at(self, t: float) -> FloatArray: ...


class Loaded(Protocol):
    """Rows (n,) with loads that depend on time only: loads (n, j) times amplitudes, and tabulated
    loads."""

    @property
    def loads(self) -> FloatArray: ...
    @property
    def amplitudes(self) -> Sequence[Amplitude]: ...
    @property
    def tables(self) -> Sequence[Tabled]: ...


def projected_tables(
    tables: Sequence[LoadTable], test: Callable[[Csr], Csr]
) -> tuple[Table, ...]:
    """Tables of the loads projected by a linear map `test` of the block's rows, sparse or dense;
    loads tabulated at the same times are added up."""
    found: list[Table] = []
    for load in tables:
        columns = test(load.columns)
        one = load.table.through(np.asarray(columns.toarray() if issparse(columns) else columns))
        same = [i for i, t in enumerate(found) if np.array_equal(t.times, one.times)]
        if same:
            found[same[0]] = Table(one.times, found[same[0]].values + one.values)
        else:
            found.append(one)
    return tuple(found)


def total_load(tables: Sequence[Tabled], t: float) -> FloatArray:
    """Sum at t, s, of one or more tabulated loads of equal length."""
    return sum((table.at(t) for table in tables[1:]), tables[0].at(t))


def total_load_along(tables: Sequence["Moving"], times: FloatArray) -> FloatArray:
    """Sum (T, n) at times (T,), s, of one or more tabulated loads of equal length; read-only."""
    return sum((table.along(times) for table in tables[1:]), tables[0].along(times))


def plus_loads(r: FloatArray, rows: Loaded, t: float, sign: float = 1.0) -> FloatArray:
    """r (n,) plus sign times the loads at t, s."""
    if rows.amplitudes:
        r = r + sign * (rows.loads @ evaluate_amplitudes(rows.amplitudes, t))
    return np.asarray(r + sign * total_load(rows.tables, t) if rows.tables else r)


@dataclass(frozen=True, slots=True, eq=False)
class TabulatedLoads:
    """Projected loads left (s, m) @ table.at(t), for tabulated loads (T, m) of the projected
    rows."""

    table: Table
    left: FloatArray

    def at(self, t: float) -> FloatArray:
        """Loads (s,) at time t, s."""
        return np.asarray(self.left.dot(self.table.at(t)))

    def along(self, times: FloatArray) -> FloatArray:
        """Loads (T, s) at times (T,), s."""
        return times_rows(self.table.along(times), self.left)

    def through(self, left: FloatArray) -> "TabulatedLoads":
        """These loads multiplied by left (l, s)."""
        return TabulatedLoads(self.table, left @ self.left)


@dataclass(frozen=True, slots=True, eq=False)
class ChosenLoads:
    """Values of tabulated loads (T, m) in the rows `chosen` (s,), read at each evaluation."""

    table: Table
    chosen: IntArray

    def at(self, t: float) -> FloatArray:
        """Loads (s,) at time t, s."""
        return self.table.at(t)[self.chosen]

    def along(self, times: FloatArray) -> FloatArray:
        """Loads (T, s) at times (T,), s."""
        return self.table.along(times)[:, self.chosen]

    def through(self, left: FloatArray) -> TabulatedLoads:
        """These loads multiplied by left (l, s)."""
        return TabulatedLoads(self.table.columns(self.chosen), left)


Moving = Table | TabulatedLoads | ChosenLoads
"""Tabulated loads with a value (s,) at each time."""


def tabulated(tables: Sequence[Table], left: FloatArray, for_good: bool) -> tuple[Moving, ...]:
    """Tabulated loads projected by left (s, m): for all times at once if `for_good`, i.e. the
    projection stays the same in the whole run; otherwise at each evaluation, because the active
    atoms may change."""
    return tuple(t.through(left) if for_good else TabulatedLoads(t, left) for t in tables)


@dataclass(frozen=True, slots=True, eq=False)
class LoadsInTime:
    """Function of time: base (s,) + loads (s, j) times amplitudes + tabulated loads."""

    base: FloatArray
    loads: FloatArray
    amplitudes: tuple[Amplitude, ...]
    tables: tuple[Moving, ...]

    def __call__(self, times: FloatArray) -> FloatArray:
        return along(self.base, self.loads, self.amplitudes, self.tables, times)

    def at(self, t: float) -> FloatArray:
        """Values (s,) at t, s."""
        r = self.base
        if self.amplitudes:
            r = r + self.loads.dot(evaluate_amplitudes(self.amplitudes, t))
        return r + total_load(self.tables, t) if self.tables else r

    def table(self, times: FloatArray) -> TimeTable:
        """These values tabulated at the times (T,), s."""
        return TimeTable.tabulate(self, times, self.at)

    def less(self, fixed: FloatArray) -> "LoadsInTime":
        """These values less constant ones (s,)."""
        return replace(self, base=self.base - fixed)

    def through(self, left: FloatArray) -> "LoadsInTime":
        """Values (l,) multiplied by left (l, s)."""
        return LoadsInTime(left @ self.base, left @ self.loads, self.amplitudes,
                           tuple(t.through(left) for t in self.tables))


def sum_of(parts: Sequence[LoadsInTime]) -> LoadsInTime:
    """Sum of functions with equal numbers of values."""
    return LoadsInTime(
        sum((p.base for p in parts[1:]), parts[0].base), np.hstack([p.loads for p in parts]),
        tuple(a for p in parts for a in p.amplitudes), tuple(t for p in parts for t in p.tables))


def along(
    base: FloatArray, loads: FloatArray, amplitudes: Sequence[Amplitude],
    tables: Sequence[Moving], times: FloatArray,
) -> FloatArray:
    """Sum (T, s) of base, (s,) or (T, s), loads (s, j) times amplitudes, and tabulated loads, at
    times (T,), s."""
    rows = np.zeros((len(times), base.shape[-1])) + base
    if amplitudes:
        rows += times_rows(amplitudes_along(amplitudes, times), loads)
    if tables:
        rows += total_load_along(tables, times)
    return rows
