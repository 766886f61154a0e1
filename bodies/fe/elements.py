"""Element matrices of linear simplices in closed form: the sums in volume.py and elasticity.py
before they are summed."""

from math import factorial

import numpy as np

from sparsemor.bodies.fe.elasticity import Law
from sparsemor.bodies.mesh.simplices import gradients, signed_measures
from sparsemor.core.arrays import FloatArray
from sparsemor.core.mesh import Mesh


def element_stiffness(mesh: Mesh, law: Law, thickness: float = 1.0) -> FloatArray:
    """(E, d (d + 1), d (d + 1)), N/m; entry number is d * corner + component."""
    g, (E, corners, d) = gradients(mesh), mesh.cells.shape + (mesh.dimension,)
    spread = law.lam * np.einsum("eai,ebj->eaibj", g, g)
    shear = law.mu * np.einsum("eaj,ebi->eaibj", g, g)
    shear += law.mu * np.einsum("eak,ebk,ij->eaibj", g, g, np.eye(d))
    size = thickness * _measures(mesh)
    whole = size[:, None, None] * (spread + shear).reshape(E, corners * d, corners * d)
    return np.asarray(whole)


def element_coupling(mesh: Mesh, law: Law, thickness: float = 1.0) -> FloatArray:
    """(E, d (d + 1), d + 1), N/K: nodal thermal forces of an element by its temperatures."""
    g, corners = gradients(mesh), mesh.cells.shape[1]
    size = thickness * law.beta / corners * _measures(mesh)
    column = (size[:, None, None] * g).reshape(len(g), -1, 1)
    return np.repeat(column, corners, axis=2)


def element_capacity(mesh: Mesh, weight: float, lumped: bool = False) -> FloatArray:
    """(E, d + 1, d + 1): integral of weight phi_i phi_j; weight rho c thickness gives J/K. lumped:
    its row sums, on the diagonal."""
    d = mesh.dimension
    if lumped:
        return np.asarray(weight * _measures(mesh)[:, None, None] * np.eye(d + 1) / (d + 1))
    # over a simplex of dimension d: integral phi_i phi_j = measure d! (1 + delta_ij) / (d + 2)!
    local = (np.ones((d + 1, d + 1)) + np.eye(d + 1)) * (factorial(d) / factorial(d + 2))
    return np.asarray(weight * _measures(mesh)[:, None, None] * local)


def element_conductivity(mesh: Mesh, weight: float) -> FloatArray:
    """(E, d + 1, d + 1): integral of weight grad phi_i . grad phi_j; weight k thickness: W/K."""
    g = gradients(mesh)
    size = weight * _measures(mesh)
    return np.asarray(size[:, None, None] * (g @ g.transpose(0, 2, 1)))


def _measures(mesh: Mesh) -> FloatArray:
    """(E,) area (m2) or volume (m3)."""
    return np.abs(signed_measures(mesh.points, mesh.cells))
