"""A load that moves over a body, as a term: constant columns times one row of a table a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.protocols import Trial
from sparsemor.core.stage import SurfaceLoads
from sparsemor.core.tables import LoadTable, Table

if TYPE_CHECKING:
    from sparsemor.bodies.body import Body


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
    """r = -load at t on global `rows` (m,), load.columns (m, j). It reads no unknown.

    `body` owns the block of the rows, and takes the term apart for fast steps.
    """

    body: str
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

    def over(self, block: IntArray) -> LoadTable:
        """The load with one row for each of the global numbers `block` (n,), in a row."""
        m = self.load.columns.tocoo()
        places = (self.rows[m.row] - block[0], m.col)
        shape = (len(block), m.shape[1])
        return replace(self.load, columns=csr_array((m.data, places), shape=shape))


def surface_terms(
    body: Body, layout: Layout, source: str, loads: SurfaceLoads, times: FloatArray
) -> Sequence[TableTerm]:
    """Forces on the elastic and heat on the thermal unknowns of the loaded nodes.

    A frame that is given needs no resultants: its rigid equations are not solved.
    """
    names = [f"{source}, node {n}" for n in loads.nodes.tolist()]
    terms: list[TableTerm] = []
    if body.elasticity is not None:
        d = loads.force.shape[2]
        dofs = (d * loads.nodes[:, None] + np.arange(d)).ravel()
        force = loads.force.reshape(len(times), -1)
        terms += _term(body, layout, "elastic", body.elasticity.free, dofs, source,
                       [f"{n}, {axis}" for n in names for axis in "xyz"[:d]], Table(times, force))
    if body.heat is not None:
        terms += _term(body, layout, "thermal", body.heat.free, loads.nodes, source, names,
                       Table(times, loads.heat))
    return terms


def _term(
    body: Body, layout: Layout, field: str, free: IntArray, places: IntArray, source: str,
    names: Sequence[str], table: Table,
) -> Sequence[TableTerm]:
    """Column i of the table acts on place number places[i] of a field; where that is no unknown
    (held displacements, given temperatures) it does nothing. No term where it acts on none."""
    acts = np.flatnonzero(np.isin(places, free))
    if not len(acts):
        return ()
    local = np.unique(np.searchsorted(free, places[acts]))
    at = np.searchsorted(free[local], places[acts])
    columns = csr_array((np.ones(len(acts)), (at, np.arange(len(acts)))),
                        shape=(len(local), len(acts)))
    rows = body.position(layout, field)[local]
    return [TableTerm(body.name, rows, LoadTable(
        source, columns, tuple(names[i] for i in acts.tolist()), table.columns(acts)))]
