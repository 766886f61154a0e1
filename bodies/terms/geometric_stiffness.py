"""Geometric stiffness of a body: the change of its stiffness by its stress (`stress_stiffness`),
and by the loads of the moment (`strains: prestressed`).

In the latter the stress that stiffens or softens a body is that of its static response to its
present loads with linear strains. It is linear in them, so that each direction P_j, by which rigid
motion, joint forces and loads act on the displacements u with a factor sigma_j(y, t), has one
constant matrix:

    M u'' + K u + ... + sum_j sigma_j (P_j + H_j u) = 0,     H_j = K_s(-K^-1 P_j),

K_s as in `stress_stiffness` (Likins 1974; Banerjee and Dickens 1990, doi 10.2514/3.20540).
"""

from __future__ import annotations

from collections.abc import MutableMapping

import numpy as np
from scipy.sparse import csr_array, eye_array, kron
from scipy.sparse.linalg import splu

from sparsemor.bodies.fem.elasticity import Anisotropy
from sparsemor.bodies.fem.field_matrices import HasFields
from sparsemor.bodies.fem.integrals import on_cells
from sparsemor.bodies.terms.field_kinds import ELASTIC
from sparsemor.core import Csr, DofLocations, FloatArray, InputError
from sparsemor.core.linalg.nested_dissection import dissect

Kept = MutableMapping[bytes, Csr]
"""Matrices H_j by the numbers of the load P_j."""


def load_stiffness(
    body: HasFields, directions: FloatArray, kept: Kept
) -> tuple[Csr, ...]:
    """Geometric stiffness H_j = K_s(-K^-1 P_j) (n, n) for each column P_j of `directions` (n, p),
    by which a load acts on the left-hand side of the free displacements with a factor, so that -P_j
    is the force; zero for a zero column. kept: matrices by the bytes of P_j found before, to which
    new ones are added."""
    columns = np.ascontiguousarray(directions.T)
    new = [j for j, P in enumerate(columns) if P.any() and P.tobytes() not in kept]
    if new:
        u = static_response(body, -directions[:, new])
        for j, shape in zip(new, u.T, strict=True):
            kept[columns[j].tobytes()] = geometric_stiffness(body, _nodal(body, shape), None)
    n = directions.shape[0]
    return tuple(kept[P.tobytes()] if P.any() else csr_array((n, n)) for P in columns)


def thermal_stiffness(body: HasFields, force: FloatArray) -> Csr:
    """Geometric stiffness (n, n) of constant temperatures T0, whose forces are `force` (n,)."""
    assert body.T0 is not None and body.T_ref is not None
    u = static_response(body, force[:, None])[:, 0]
    return geometric_stiffness(body, _nodal(body, u), body.T0 - body.T_ref)


def static_response(body: HasFields, forces: FloatArray) -> FloatArray:
    """K^-1 f of the n free displacements, m, (n, j), under j columns of forces (n, j), N; K is
    factorized in an order that keeps it sparse. InputError where the reference condition leaves
    rigid motion."""
    e, mesh = body.elasticity, body.mesh
    assert e is not None and mesh is not None
    K, d = csr_array(e.stiffness[e.free][:, e.free]), mesh.dimension
    order = dissect(K, DofLocations(mesh.points[e.free // d], e.free % d)).order
    try:
        factor = splu(K[order][:, order].tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0,
                      options={"SymmetricMode": True})
    except RuntimeError:
        raise InputError("the reference condition leaves rigid motion, with which a body has no "
                         "static response to its loads: hold more", f"{ELASTIC.name}") from None
    found = np.empty(forces.shape)
    found[order] = factor.solve(np.ascontiguousarray(forces[order]))
    return found


def _nodal(body: HasFields, u: FloatArray) -> FloatArray:
    """Displacements (N, d) of all nodes from the free ones (n,)."""
    assert body.mesh is not None and body.elasticity is not None
    whole = np.zeros(body.mesh.points.size)
    whole[body.elasticity.free] = u
    return whole.reshape(body.mesh.points.shape)


def stress_stiffness(
    body: HasFields, u: FloatArray, T: FloatArray | None
) -> tuple[Csr, Csr]:
    """Stiffness K and geometric stiffness K_s of the free displacements, (n, n), N/m:

        v^T K_s u = integral of grad u_i . sigma grad v_i

    for the stress sigma of displacements u (N, d), m, and temperatures T (N,), K; None without a
    thermal field. Both have the properties at the reference temperature: a modulus that falls with
    temperature scales both alike.
    """
    e = body.elasticity
    assert e is not None and body.T0 is not None and body.T_ref is not None
    rise = (body.T0 if T is None else T) - body.T_ref
    F = e.free
    return e.stiffness[F][:, F], geometric_stiffness(body, u, rise)


def geometric_stiffness(body: HasFields, u: FloatArray, rise: FloatArray | None) -> Csr:
    """Geometric stiffness K_s (n, n), N/m, of the free displacements, v^T K_s w = integral of grad
    w_i . sigma grad v_i, for the stress sigma of displacements u (N, d), m; rise (N,): temperature
    above that without stress, K; None for zero."""
    e, mesh = body.elasticity, body.mesh
    assert e is not None and mesh is not None
    N, d = mesh.points.shape
    found = csr_array((N, N))
    for cells, law in e.regions:
        for _, at in on_cells(mesh, 0, cells):
            nodes, gradients = at.shape.nodes, at.shape.gradients
            assert gradients is not None
            # gradient, strain and stress in axes (d, d, element, point)
            G = np.einsum("eni,enjq->ijeq", u[nodes], gradients)
            strain = (G + G.swapaxes(0, 1)) / 2.0
            if e.nonlinear:
                strain = strain + np.einsum("kieq,kjeq->ijeq", G, G) / 2.0
            if law.anisotropy is None:
                stress, beta = 2.0 * law.mu * strain, law.beta * np.eye(d)
                stress[range(d), range(d)] += law.lam * np.einsum("iieq->eq", strain)
            else:
                stress, beta = _directional(law.anisotropy, strain), law.anisotropy.beta
            if rise is not None:
                stress = stress - beta[:, :, None, None] * (
                    rise[nodes][:, None, :] @ at.shape.values)[:, 0]
            # one matrix for all components of the displacements: integral of grad . sigma grad
            weighted = stress * (body.thickness * at.weights)
            wide = np.broadcast_to(gradients, (*gradients.shape[:3], weighted.shape[3]))
            local = np.einsum("enaq,abeq,embq->enm", wide, weighted, wide, optimize=True)
            rows = np.broadcast_to(nodes[:, :, None], local.shape)
            columns = np.broadcast_to(nodes[:, None, :], local.shape)
            found = found + csr_array((local.ravel(), (rows.ravel(), columns.ravel())),
                                      shape=(N, N))
    whole = csr_array(kron(found, eye_array(d), format="csr"))
    return csr_array(whole[e.free][:, e.free])


def _directional(law: Anisotropy, strain: FloatArray) -> FloatArray:
    """Stress (d, d, E, Q) of strains (d, d, E, Q) by a stiffness that depends on the direction, in
    the order of components of `Anisotropy.C`, shear strains doubled."""
    pairs = [(0, 0), (1, 1), (0, 1)] if len(strain) == 2 else [
        (0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)]
    values = np.tensordot(law.C, np.stack([
        strain[i, j] * (1.0 if i == j else 2.0) for i, j in pairs]), 1)
    found = np.zeros_like(strain)
    for (i, j), value in zip(pairs, values, strict=True):
        found[i, j] = found[j, i] = value
    return found
