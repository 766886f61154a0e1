"""Scalar matrices of linear simplices: mass, capacity, conductivity."""

from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array

from sparsemor.core.arrays import Csr, IntArray
from sparsemor.core.mesh import Mesh

CHUNK = 1 << 16
"""Cells assembled at a time: what is held beside the matrix stays below 100 MB."""


def scalar_mass(mesh: Mesh, weight: float) -> Csr:
    """(N, N): integral of weight * phi_i * phi_j, consistent (not lumped).

    weight: rho * thickness (kg/m2) in 2-D, rho (kg/m3) in 3-D, for the mass of one displacement
    component; times the specific heat (J/(kg K)) for the heat capacity (J/K).
    """
    def form(u: Any, v: Any, w: Any) -> Any:
        return weight * u * v

    return assemble(form, mesh, 2)


def capacity(mesh: Mesh, rho: float, c: float, thickness: float = 1.0) -> Csr:
    """(N, N), J/K: integral of rho c phi_i phi_j. thickness in m, 1 in 3-D."""
    return scalar_mass(mesh, rho * c * thickness)


def lumped(matrix: Csr) -> Csr:
    """(N, N): the row sums of a mass or capacity on its diagonal. Its integral is the same."""
    sums = np.asarray(matrix.sum(axis=1)).ravel()
    return csr_array(diags_array(sums))


def conductivity(mesh: Mesh, k: float, thickness: float = 1.0) -> Csr:
    """(N, N), W/K: integral of k grad phi_i . grad phi_j. thickness in m, 1 in 3-D."""
    from skfem.helpers import dot, grad

    def form(u: Any, v: Any, w: Any) -> Any:
        return k * thickness * dot(grad(u), grad(v))

    return assemble(form, mesh, 0)


def assemble(form: Any, mesh: Mesh, order: int) -> Csr:
    """(N, N): the matrix of a bilinear form of one value a node, columns by its first argument.

    Polynomials of `order` are integrated exactly. Matrices of vector fields are put together from
    such ones: a form of d components would be evaluated d^2 times as often.
    """
    import skfem

    n = len(mesh.points)
    whole = csr_array((n, n))
    for start in range(0, len(mesh.cells), CHUNK):
        simplex, element = _simplex(mesh, mesh.cells[start : start + CHUNK])
        basis = skfem.Basis(simplex, element, intorder=max(order, 1))
        part = csr_array(skfem.BilinearForm(form).assemble(basis))
        part.sum_duplicates()
        # scikit-fem stops at the last point that a cell uses, and a mesh may hold some cells only
        part.resize((n, n))
        whole = part if start == 0 else whole + part
    return whole


def _simplex(mesh: Mesh, cells: IntArray) -> tuple[Any, Any]:
    import skfem

    points, corners = np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(cells.T)
    if mesh.dimension == 2:
        return skfem.MeshTri(points, corners), skfem.ElementTriP1()
    return skfem.MeshTet(points, corners), skfem.ElementTetP1()
