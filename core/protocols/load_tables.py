"""Loads that move over a body: constant columns, and how much of each at tabled times."""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import issparse

from sparsemor.core.arrays import Csr, FloatArray, IntArray, Matrix


def place(times: FloatArray, t: float) -> tuple[int, float]:
    """(i, w): t is at (1 - w) times[i] + w times[i + 1]; w = 0 at a tabled time and outside."""
    i = bisect_left(times, t)
    if i == len(times):
        return i - 1, 0.0
    if i == 0 or times[i] == t:
        return i, 0.0
    w = float((t - times[i - 1]) / (times[i] - times[i - 1]))
    # a time of the step grid that was summed up differently is that time
    if w > 1.0 - 1e-9:
        return i, 0.0
    return i - 1, 0.0 if w < 1e-9 else w


def blended(values: FloatArray, i: int, w: float) -> FloatArray:
    """values (T, ...) at what `place` found; a row of the table itself where w = 0."""
    return np.asarray(values[i] if w == 0.0 else (1.0 - w) * values[i] + w * values[i + 1])


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """values (T, j) at increasing times (T,), s; linear between them, constant outside."""

    times: FloatArray
    values: FloatArray

    def at(self, t: float) -> FloatArray:
        """(j,) values at t, s. At a tabled time they are exactly those of the table."""
        return blended(self.values, *place(self.times, t))

    def along(self, times: FloatArray) -> FloatArray:
        """(T, j) values at times (T,), s; at its own times the table itself, not a copy."""
        if np.array_equal(times, self.times):
            return self.values
        return np.array([self.at(t) for t in times.tolist()])

    def columns(self, chosen: IntArray) -> "Table":
        """The columns number `chosen`, copied."""
        return Table(self.times, np.ascontiguousarray(self.values[:, chosen]))

    def over(self, size: float) -> "Table":
        """All values divided by a size."""
        return Table(self.times, self.values / size)

    def through(self, left: FloatArray) -> "Table":
        """left (l, j) times every row: (T, l) values."""
        return Table(self.times, np.ascontiguousarray(self.values @ left.T))


@dataclass(frozen=True, slots=True, eq=False)
class LoadTable:
    """columns @ table.at(t): the load on one block of n unknowns.

    columns (n, j): one a point of the surface and component, unit amplitude; names (j,): what
    each is ("sole, node 12, x"); source: the part of the scene that it comes from.
    """

    source: str
    columns: Csr
    names: tuple[str, ...]
    table: Table

    def at(self, t: float) -> FloatArray:
        """(n,) the load at t, s."""
        return np.asarray(self.columns @ self.table.at(t))

    def seen(self, left: FloatArray) -> Table:
        """left (l, n): what `left` sees of the load, (T, l) values: no length of the mesh left."""
        return self.table.through(np.asarray(left @ self.columns))


class Tabled(Protocol):
    """Anything with values at a time, s."""

    def at(self, t: float) -> FloatArray: ...


class TabledAlong(Protocol):
    """Anything with values at many times (T,), s."""

    def along(self, times: FloatArray) -> FloatArray: ...


def projected_tables(
    tables: Sequence[LoadTable], test: Callable[[Csr], Matrix]
) -> tuple[Table, ...]:
    """Tables of all loads projected by a linear map `test` of the block's rows, merged by times."""
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
    """Sum of one or more loads of equal length at t, s."""
    value = tables[0].at(t)
    for table in tables[1:]:
        value = value + table.at(t)
    return value


def total_load_along(tables: Sequence[TabledAlong], times: FloatArray) -> FloatArray:
    """The same at times (T,), s: (T, n), not to be written to."""
    value = tables[0].along(times)
    for table in tables[1:]:
        value = value + table.along(times)
    return value
