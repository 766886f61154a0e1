"""Contributions of a body's fields to the equations: elasticity, conduction, convection."""

from __future__ import annotations

import numpy as np

from sparsemor.bodies.fem.fields import Elasticity, HasFields, Heat
from sparsemor.core import Amplitude, Csr, Equations, FloatArray


def write_elasticity(body: HasFields, equations: Equations, e: Elasticity) -> None:
    """Adds stiffness, damping and thermal forces of the free displacements."""
    F, Kt = e.free, e.coupling[e.free]
    block, thermal = f"{body.name}.elastic", f"{body.name}.thermal"
    equations.matrix(block, block, A=e.stiffness[F][:, F], B=e.damping[F][:, F])
    assert body.T0 is not None and body.T_ref is not None
    if body.heat is None:
        equations.vector(block, np.asarray(Kt @ (body.T0 - body.T_ref)))
        return
    equations.vector(block, -np.asarray(Kt @ body.T_ref))
    equations.matrix(block, thermal, A=-Kt[:, body.heat.free])
    for nodes, function in body.heat.prescribed:
        equations.vector(block, _row_sums(Kt[:, nodes]), function.value, "prescribed")


def write_conduction(body: HasFields, equations: Equations, h: Heat) -> None:
    """Adds conduction and capacity of the free temperatures."""
    block, free = f"{body.name}.thermal", h.free
    equations.matrix(block, block, A=h.conductivity[free][:, free], B=h.capacity[free][:, free])
    for nodes, function in h.prescribed:
        for matrix, f in ((h.conductivity, function.value), (h.capacity, function.rate)):
            equations.vector(block, -_row_sums(matrix[free][:, nodes]), f, "prescribed")


def write_film(
    body: str, equations: Equations, heat: Heat, vector: FloatArray, amplitude: Amplitude,
    film: Csr | None,
) -> None:
    """Adds a nodal heat vector (N,), W, times an amplitude, and a convection matrix `film` (N, N),
    W/K."""
    block, free = f"{body}.thermal", heat.free
    equations.vector(block, vector[free], amplitude)
    if film is None:
        return
    mine = film[free]
    equations.matrix(block, block, A=mine[:, free])
    for nodes, function in heat.prescribed:
        equations.vector(block, -_row_sums(mine[:, nodes]), function.value, "prescribed")


def _row_sums(matrix: Csr) -> FloatArray:
    return np.asarray(matrix.sum(axis=1)).ravel()
