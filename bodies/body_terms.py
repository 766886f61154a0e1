"""The terms that a body has by itself: inertia (in the plane), elasticity, conduction, films."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array, hstack, kron

from sparsemor.bodies.fields import Elasticity, Heat
from sparsemor.bodies.frame_term import FrameTerm
from sparsemor.bodies.linear_term import LinearEquations, LinearTerm
from sparsemor.bodies.planar.items import Inertia
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.separable import Amplitude

if TYPE_CHECKING:
    from sparsemor.bodies.body import Body
    from sparsemor.bodies.body_part import PlanarBody

J2 = np.array([[0.0, -1.0], [1.0, 0.0]])


def inertia_term(body: PlanarBody, layout: Layout) -> FrameTerm:
    """Inertia of the rigid and elastic unknowns: one frame term with mass and M J."""
    item = Inertia(body.mass, body.moment, body.inertia)
    if body.elasticity is None or body.mass_matrix is None:
        return body.frame_term(layout, item, ())
    m = body.mass_matrix
    vectors = (np.asarray(m.sum(axis=1), dtype=complex), m @ body.X)
    term = body.frame_term(layout, item, vectors, every=True)
    F = body.elasticity.free
    M, G = (csr_array(kron(m, B, format="csr")[F][:, F]) for B in (np.eye(2), J2))
    local = np.searchsorted(term.columns, body.position(layout, "elastic"))
    embed = _embedding(local, len(term.columns))
    Q = tuple(csr_array(embed.T @ A @ embed) for A in (M, G))
    return replace(term, equations=replace(term.equations, Q=Q, V=Q))


def elastic_term(body: Body, layout: Layout, e: Elasticity) -> LinearTerm:
    """Stiffness, damping and thermal forces of the free displacements."""
    F, Kt = e.free, e.coupling[e.free]
    rows = body.position(layout, "elastic")
    columns, A = rows, [e.stiffness[F][:, F]]
    B = [e.damping[F][:, F]]
    assert body.T0 is not None and body.T_ref is not None
    loads: list[FloatArray] = []
    amplitudes: list[Amplitude] = []
    if body.heat is None:
        constant = Kt @ (body.T0 - body.T_ref)
    else:
        constant = -(Kt @ body.T_ref)
        free = body.heat.free
        columns = np.concatenate([columns, body.position(layout, "thermal")])
        A.append(-Kt[:, free])
        B.append(csr_array((len(F), len(free))))
        for nodes, function in body.heat.prescribed:
            loads.append(np.asarray(Kt[:, nodes].sum(axis=1)).ravel())
            amplitudes.append(function.value)
    return LinearTerm(body.name, rows, columns, LinearEquations(
        _side_by_side(A), _side_by_side(B), np.asarray(constant),
        np.stack(loads, axis=1) if loads else np.zeros((len(F), 0)), tuple(amplitudes)))


def thermal_term(body: Body, layout: Layout, h: Heat) -> LinearTerm:
    """Conduction and capacity of the free temperatures."""
    rows, free = body.position(layout, "thermal"), h.free
    loads: list[FloatArray] = []
    amplitudes: list[Amplitude] = []
    for nodes, function in h.prescribed:
        for matrix, f in ((h.conductivity, function.value), (h.capacity, function.rate)):
            loads.append(-np.asarray(matrix[free][:, nodes].sum(axis=1)).ravel())
            amplitudes.append(f)
    return LinearTerm(body.name, rows, rows, LinearEquations(
        csr_array(h.conductivity[free][:, free]), csr_array(h.capacity[free][:, free]),
        np.zeros(len(free)), np.stack(loads, axis=1) if loads else np.zeros((len(free), 0)),
        tuple(amplitudes)))


def film_term(
    body: str, thermal: IntArray, heat: Heat, vector: FloatArray, amplitude: Amplitude,
    film: Csr | None,
) -> LinearTerm:
    """Nodal heat vector (N,) W times an amplitude, and a film matrix (N, N) W/K.

    thermal (m,): global numbers of the body's temperatures.
    """
    free = heat.free
    used = np.flatnonzero(vector[free])
    rows, nodes = thermal[used], free[used]
    empty = csr_array((len(rows), len(rows)))
    A = empty if film is None else csr_array(film[nodes][:, nodes])
    loads, amplitudes = [vector[nodes]], [amplitude]
    if film is not None:
        for given, function in heat.prescribed:
            loads.append(-np.asarray(film[nodes][:, given].sum(axis=1)).ravel())
            amplitudes.append(function.value)
    return LinearTerm(body, rows, rows, LinearEquations(
        A, empty, np.zeros(len(rows)), np.stack(loads, axis=1), tuple(amplitudes)))


def _embedding(local: IntArray, size: int) -> Csr:
    """(len(local), size) selection matrix."""
    n = len(local)
    return csr_array((np.ones(n), (np.arange(n), local)), shape=(n, size))


def _side_by_side(matrices: list[Csr]) -> Csr:
    return csr_array(hstack(matrices, format="csr"))
