"""A body's internal force and heat balance, element by element (core/integrals.py)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sparsemor.bodies.fe.elements import (
    element_capacity,
    element_conductivity,
    element_coupling,
    element_stiffness,
)
from sparsemor.bodies.fields import Heat
from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.integrals import ElasticIntegrals, HeatIntegrals, Integrals
from sparsemor.core.mesh import Mesh
from sparsemor.core.separable import Amplitude

if TYPE_CHECKING:
    from sparsemor.bodies.body import Body


def elastic_integrals(body: Body) -> ElasticIntegrals:
    """Internal forces of the free displacements: the terms of `body_terms.elastic_term`."""
    e, mesh = body.elasticity, body.mesh
    assert e is not None and e.law is not None and mesh is not None
    K = element_stiffness(mesh, e.law, body.thickness)
    Kt = element_coupling(mesh, e.law, body.thickness)
    n = len(e.free)
    d = mesh.dimension
    corners = d * mesh.cells[:, :, None] + np.arange(d)
    rows = _places(e.free, d * len(mesh.points))[corners.reshape(len(mesh.cells), -1)]
    assert body.T0 is not None and body.T_ref is not None
    stiffness = Integrals(rows, rows, K, (n, n))
    if body.heat is None:
        return ElasticIntegrals(
            stiffness, None, _columns(rows, n, [_applied(Kt, mesh, body.T0 - body.T_ref)]), ())
    nodes = _places(body.heat.free, len(mesh.points))[mesh.cells]
    given, amplitudes = [-_applied(Kt, mesh, body.T_ref)], []
    for held, function in body.heat.prescribed:
        given.append(_applied(Kt, mesh, _indicator(mesh, held)))
        amplitudes.append(function.value)
    coupling = Integrals(rows, nodes, Kt, (n, len(body.heat.free)))
    return ElasticIntegrals(stiffness, coupling, _columns(rows, n, given), tuple(amplitudes))


def heat_integrals(body: Body) -> HeatIntegrals:
    """Heat balance of the free temperatures: the terms of `body_terms.thermal_term`."""
    h, mesh = body.heat, body.mesh
    assert h is not None and h.constants is not None and mesh is not None
    capacity, conductivity = h.constants
    C = element_capacity(mesh, capacity, h.lumped)
    K = element_conductivity(mesh, conductivity)
    n = len(h.free)
    nodes = _places(h.free, len(mesh.points))[mesh.cells]
    given, amplitudes = _prescribed(h, mesh, C, K)
    return HeatIntegrals(
        Integrals(nodes, nodes, C, (n, n)), Integrals(nodes, nodes, K, (n, n)),
        _columns(nodes, n, given), amplitudes)


def _prescribed(
    h: Heat, mesh: Mesh, C: FloatArray, K: FloatArray
) -> tuple[list[FloatArray], tuple[Amplitude, ...]]:
    """What given temperatures and their rates take from the rows beside them."""
    columns, amplitudes = [np.zeros(mesh.cells.shape)], []
    for held, function in h.prescribed:
        there = _indicator(mesh, held)
        columns += [-_applied(K, mesh, there), -_applied(C, mesh, there)]
        amplitudes += [function.value, function.rate]
    return columns, tuple(amplitudes)


def _places(free: IntArray, size: int) -> IntArray:
    """(size,) position of each unknown among the free ones, -1 where it is none."""
    places = np.full(size, -1, dtype=np.int64)
    places[free] = np.arange(len(free))
    return places


def _indicator(mesh: Mesh, nodes: IntArray) -> FloatArray:
    there = np.zeros(len(mesh.points))
    there[nodes] = 1.0
    return there


def _applied(matrices: FloatArray, mesh: Mesh, nodal: FloatArray) -> FloatArray:
    """(E, p): element matrices (E, p, d + 1) times nodal values (N,)."""
    return np.asarray(np.einsum("epc,ec->ep", matrices, nodal[mesh.cells]))


def _columns(rows: IntArray, n: int, given: Sequence[FloatArray]) -> Integrals:
    """Vectors (E, p), one for each column."""
    columns = np.broadcast_to(np.arange(len(given)), (len(rows), len(given)))
    return Integrals(rows, columns, np.stack(given, axis=2), (n, len(given)))
