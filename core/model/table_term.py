"""A load that moves over a body, as a term: constant columns times one row of a table a step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.model.frame_term import numbers
from sparsemor.core.protocols import Trial
from sparsemor.core.protocols.contributions import TableRecord
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.load_tables import LoadTable, Table


@dataclass(frozen=True, slots=True, eq=False)
class TabledRows:
    """r = -table at t, table (T, l): a compressed `TableTerm` of k reduced unknowns."""

    table: Table
    k: int

    @property
    def elements(self) -> int:
        return 0

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return -self.table.at(t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return np.zeros((self.table.values.shape[1], self.k))


@dataclass(frozen=True, slots=True, eq=False)
class TableTerm:
    """r = -load at t on global `rows` (m,), load.columns (m, j). It reads no unknown."""

    rows: IntArray
    load: LoadTable
    elements: int = 0

    @property
    def columns(self) -> IntArray:
        return np.zeros(0, np.int64)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return -self.load.at(t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        return csr_array((len(self.rows), 0))

    def restrict(self, keep: IntArray) -> TableTerm:
        columns = csr_array(self.load.columns[keep])
        return replace(self, rows=self.rows[keep], load=replace(self.load, columns=columns))

    def compress(self, trial: Trial, left: FloatArray) -> TabledRows:
        return TabledRows(self.load.seen(left), trial.atoms.shape[1])


def table_term(layout: Layout, record: TableRecord) -> TableTerm:
    """The load of one record, in the rows that it acts on."""
    load = record.load
    used = np.flatnonzero(np.diff(load.columns.indptr))
    rows = numbers(layout, record.rows)[used]
    return TableTerm(rows, replace(load, columns=csr_array(load.columns[used])))
