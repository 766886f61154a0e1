"""Geometric stiffness of a body: the change of its stiffness by its stress."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, eye_array, kron

from sparsemor.bodies.fem.elasticity import Anisotropy
from sparsemor.bodies.fem.fields import HasFields
from sparsemor.bodies.fem.integrals import on_cells
from sparsemor.core import Csr, FloatArray


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
    """K_s of `stress_stiffness` alone; rise (N,): temperature above that without stress, K; None
    for zero."""
    e, mesh = body.elasticity, body.mesh
    assert e is not None and mesh is not None
    N, d = mesh.points.shape
    found = csr_array((N, N))
    for cells, law in e.regions:
        for _, at in on_cells(mesh, 0, cells):
            nodes, gradients = at.shape.nodes, at.shape.gradients
            assert gradients is not None
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
    """Stress (d, d, E, Q) of strains (d, d, E, Q) by a stiffness that depends on the direction."""
    pairs = [(0, 0), (1, 1), (0, 1)] if len(strain) == 2 else [
        (0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)]
    values = np.tensordot(law.C, np.stack([
        strain[i, j] * (1.0 if i == j else 2.0) for i, j in pairs]), 1)
    found = np.zeros_like(strain)
    for (i, j), value in zip(pairs, values, strict=True):
        found[i, j] = found[j, i] = value
    return found
