"""Loads that move over the surface of a body, as time tables of its nodal forces and heats."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array

from sparsemor.bodies.fem.fields import HasFields
from sparsemor.core import Equations, FloatArray, IntArray, SurfaceLoads, Table
from sparsemor.core.protocols import LoadTable


def write_surface_loads(
    body: HasFields, equations: Equations, loads: SurfaceLoads, times: FloatArray
) -> None:
    """Adds forces on the elastic and heat on the thermal unknowns of the loaded nodes at times
    (T,), s.

    A frame with prescribed motion needs no resultants: its rigid equations are not solved.
    """
    names = [f"{equations.origin.part}, node {n}" for n in loads.nodes.tolist()]
    if body.elasticity is not None:
        d = loads.force.shape[2]
        dofs = (d * loads.nodes[:, None] + np.arange(d)).ravel()
        force = loads.force.reshape(len(times), -1)
        _write(equations, f"{body.name}.elastic", body.elasticity.free, dofs,
               [f"{n}, {axis}" for n in names for axis in "xyz"[:d]], Table(times, force))
    if body.heat is not None:
        _write(equations, f"{body.name}.thermal", body.heat.free, loads.nodes, names,
               Table(times, loads.heat))


def _write(
    equations: Equations, block: str, free: IntArray, dofs: IntArray, names: Sequence[str],
    table: Table,
) -> None:
    """Adds a load table: its column i acts on dof number dofs[i] of a field.

    Columns of prescribed displacements or temperatures are dropped, and a table without remaining
    columns.
    """
    acts = np.flatnonzero(np.isin(dofs, free))
    if not len(acts):
        return
    at = np.searchsorted(free, dofs[acts])
    columns = csr_array((np.ones(len(acts)), (at, np.arange(len(acts)))),
                        shape=(len(free), len(acts)))
    equations.table(block, LoadTable(
        equations.origin.part, columns, tuple(names[i] for i in acts.tolist()),
        table.columns(acts)))
