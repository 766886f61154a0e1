"""Geometric stiffness by the loads of the moment (`strains: prestressed`).

The stress that stiffens or softens a body is that of its static response to its present loads with
linear strains. It is linear in them, so that each direction P_j, by which rigid motion, joint
forces and loads act on the displacements u with a factor sigma_j(y, t), has one constant matrix:

    M u'' + K u + ... + sum_j sigma_j (P_j + H_j u) = 0,     H_j = K_s(-K^-1 P_j),

K_s as in fem/stress_stiffness.py (Likins 1974; Banerjee and Dickens 1990, doi 10.2514/3.20540).
"""

from collections.abc import MutableMapping

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from sparsemor.bodies.fem.fields import HasFields
from sparsemor.bodies.fem.stress_stiffness import geometric_stiffness
from sparsemor.bodies.terms.field_kinds import ELASTIC
from sparsemor.core import Csr, FloatArray, InputError
from sparsemor.core.linalg.nested_dissection import dissect
from sparsemor.core.protocols import DofLocations

Kept = MutableMapping[bytes, Csr]
"""Matrices H_j by the numbers of the load P_j."""


def load_stiffness(
    body: HasFields, directions: FloatArray, kept: Kept
) -> tuple[Csr, ...]:
    """Matrices H_j (n, n) of the columns of `directions` (n, p); kept: those found before."""
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
    """K^-1 f of the free displacements (n, j) under forces (n, j). InputError where the reference
    condition leaves rigid motion."""
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
