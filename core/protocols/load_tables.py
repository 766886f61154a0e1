"""Time-tabulated loads that move over a body: constant load vectors times tabulated amplitudes."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray, union


def place(times: FloatArray, t: float) -> tuple[int, float]:
    """Interval i and weight w of linear interpolation: t = (1 - w) times[i] + w times[i + 1]; w = 0
    at a tabulated time and outside the table."""
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


def places(known: FloatArray, times: FloatArray) -> tuple[IntArray, FloatArray]:
    """Intervals and weights (T,) of `place` at times (T,), s, in a table at the times `known`."""
    i = np.minimum(np.searchsorted(known, times), len(known) - 1)
    before = np.maximum(i - 1, 0)
    w = np.ones(len(times))
    np.divide(times - known[before], known[i] - known[before], out=w, where=i > before)
    last = (w > 1.0 - 1e-9)
    w[last | (w < 1e-9)] = 0.0
    return np.where(last, i, before), w


def blended(values: FloatArray, i: int, w: float) -> FloatArray:
    """Linear interpolation in values (T, ...) with interval i and weight w of `place`; a view of
    row i if w = 0."""
    return np.asarray(values[i] if w == 0.0 else (1.0 - w) * values[i] + w * values[i + 1])


ROWS = 64
"""Number of rows of each product of `times_rows`."""


def times_rows(table: FloatArray, left: FloatArray) -> FloatArray:
    """table @ left.T (T, l) of a table (T, j) and a matrix (l, j), to the last bit the same in each
    row for any number of rows: BLAS may sum the last rows of a product in another order, so that
    tables of a run and of one that goes on longer would differ at their common times."""
    found = np.empty((len(table), len(left)))
    for first in range(0, len(table), ROWS):
        part = table[first : first + ROWS]
        if len(part) < ROWS:  # all products have one shape
            part = np.concatenate([part, np.zeros((ROWS - len(part), table.shape[1]))])
        found[first : first + ROWS] = part.dot(left.T)[: len(table) - first]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Values (T, j) at increasing times (T,), s; linear interpolation between them, constant
    outside."""

    times: FloatArray
    values: FloatArray

    def at(self, t: float) -> FloatArray:
        """Interpolated values (j,) at t, s; exact at tabulated times."""
        return blended(self.values, *place(self.times, t))

    def along(self, times: FloatArray) -> FloatArray:
        """Interpolated values (T, j) at times (T,), s; at the table's own times its array itself,
        not a copy."""
        known, values = self.times, self.values
        if np.array_equal(times, known):
            return values
        i, w = places(known, times)
        if not w.any():
            return np.asarray(values[i])
        after, w = np.minimum(i + 1, len(known) - 1), w[:, None]
        return np.asarray((1.0 - w) * values[i] + w * values[after])

    def columns(self, chosen: IntArray) -> "Table":
        """Table of the columns with numbers `chosen`, copied."""
        return Table(self.times, np.ascontiguousarray(self.values[:, chosen]))

    def over(self, size: float) -> "Table":
        """Table with all values divided by `size`."""
        return Table(self.times, self.values / size)

    def through(self, left: FloatArray) -> "Table":
        """Table of left @ values(t), with left (l, j)."""
        return Table(self.times, times_rows(self.values, left))


@dataclass(frozen=True, slots=True, eq=False)
class LoadTable:
    """Moving load columns @ table.at(t) on one block of n unknowns.

    columns (n, j): unit loads, one per surface point and component; names (j,): their descriptions
    ("sole, node 12, x"); source: name of the contact or load.
    """

    source: str
    columns: Csr
    names: tuple[str, ...]
    table: Table

    def at(self, t: float) -> FloatArray:
        """Load vector (n,) at t, s."""
        return np.asarray(self.columns @ self.table.at(t))

    def projected(self, left: FloatArray) -> Table:
        """Table of the projected load left @ load(t), with left (l, n)."""
        return self.table.through(np.asarray(left @ self.columns))


def loaded_columns(load: LoadTable) -> IntArray:
    """Numbers of the columns of a moving load that are nonzero at some time and act on some
    unknown."""
    acts = np.any(load.table.values != 0.0, axis=0)
    tabulated = np.asarray(abs(load.columns).sum(axis=0)).ravel() > 0.0
    return np.flatnonzero(acts & tabulated).astype(np.int64)


def path_rows(moving: Sequence[LoadTable]) -> IntArray:
    """Sorted rows that at least one of the moving loads acts on at some time."""
    return union(
        np.flatnonzero(np.asarray(abs(load.columns[:, loaded_columns(load)]).sum(axis=1)))
        for load in moving)


def ring(mass: Csr, stiffness: Csr, coordinates: FloatArray, rows: IntArray) -> IntArray:
    """Sorted rows of all elements that touch a node of `rows` (one-ring neighbourhood), found from
    the sparsity of mass and stiffness: nodes are coupled if they share an element. coordinates:
    nodes of all rows (n, d), m."""
    if not len(rows):
        return rows
    node = np.unique(coordinates, axis=0, return_inverse=True)[1].reshape(-1)
    at = np.flatnonzero(np.isin(node, node[rows]))
    pattern = _ones(mass) + _ones(stiffness)  # a triangle with a right angle lacks an entry in one
    near = np.union1d(at, pattern[at].indices)
    return np.flatnonzero(np.isin(node, node[near])).astype(np.int64)


def _ones(matrix: Csr) -> Csr:
    """Matrix with ones at the stored entries of another one."""
    m = csr_array(matrix)
    return csr_array((np.ones(m.nnz), m.indices, m.indptr), shape=m.shape)
