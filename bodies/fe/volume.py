"""Scalar matrices of linear simplices: mass, capacity, conductivity."""

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr
from sparsemor.core.mesh import Mesh


def scalar_mass(mesh: Mesh, weight: float) -> Csr:
    """(N, N): integral of weight * phi_i * phi_j, consistent (not lumped).

    weight: rho * thickness (kg/m2) in 2-D, rho (kg/m3) in 3-D, for the mass of one displacement
    component; times the specific heat (J/(kg K)) for the heat capacity (J/K).
    """
    def form(u: Any, v: Any, w: Any) -> Any:
        return weight * u * v

    return assemble(form, len(mesh.points), scalar_basis(mesh, 2))


def capacity(mesh: Mesh, rho: float, c: float, thickness: float = 1.0) -> Csr:
    """(N, N), J/K: integral of rho c phi_i phi_j. thickness in m, 1 in 3-D."""
    return scalar_mass(mesh, rho * c * thickness)


def conductivity(mesh: Mesh, k: float, thickness: float = 1.0) -> Csr:
    """(N, N), W/K: integral of k grad phi_i . grad phi_j. thickness in m, 1 in 3-D."""
    from skfem.helpers import dot, grad

    def form(u: Any, v: Any, w: Any) -> Any:
        return k * thickness * dot(grad(u), grad(v))

    return assemble(form, len(mesh.points), scalar_basis(mesh, 0))


def scalar_basis(mesh: Mesh, order: int) -> Any:
    """scikit-fem's basis of one value a node, integrating polynomials of `order` exactly."""
    import skfem

    simplex, element = _simplex(mesh)
    return skfem.Basis(simplex, element, intorder=max(order, 1))


def vector_basis(mesh: Mesh, order: int) -> Any:
    """The same for d values a node; unknown number is d * node + component."""
    import skfem

    simplex, element = _simplex(mesh)
    return skfem.Basis(simplex, skfem.ElementVector(element), intorder=max(order, 1))


def assemble(form: Any, points: int, trial: Any, test: Any = None) -> Csr:
    """The csr_array of a bilinear form: columns by `trial`, rows by `test` (default the same)."""
    import skfem

    test = trial if test is None else test
    matrix = csr_array(skfem.BilinearForm(form).assemble(trial, test))
    matrix.sum_duplicates()
    # scikit-fem stops at the last point that a cell uses, and a mesh may hold some cells only
    matrix.resize((points * test.elem.nodal_dofs, points * trial.elem.nodal_dofs))
    return matrix


def _simplex(mesh: Mesh) -> tuple[Any, Any]:
    import skfem

    points = np.ascontiguousarray(mesh.points.T)
    cells = np.ascontiguousarray(mesh.cells.T)
    if mesh.dimension == 2:
        return skfem.MeshTri(points, cells), skfem.ElementTriP1()
    return skfem.MeshTet(points, cells), skfem.ElementTetP1()
