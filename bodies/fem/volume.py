"""Integrals over cells, and scalar matrices: mass, capacity, conductivity."""

import numpy as np
from scipy.sparse import csr_array, diags_array

from sparsemor.bodies.fem.quadrature import Quadrature
from sparsemor.core import Csr, FloatArray, IntArray, Mesh


def on_cells(
    mesh: Mesh, degree: int, cells: IntArray | None = None, *, gradients: bool = True,
    at_nodes: bool = False, positive: bool = False,
) -> list[tuple[IntArray, Quadrature]]:
    """Quadrature of the cells of each kind (all, or those with the given numbers), with their
    positions among them; exact for polynomials of this degree. at_nodes: points at the nodes with
    the weights of lumped matrices; positive: without negative weights."""
    from sparsemor.bodies.fem import forms

    return forms.cell_quadratures(mesh, degree, cells, gradients, at_nodes, positive)


def scalar_mass(mesh: Mesh, weight: float, cells: IntArray | None = None) -> Csr:
    """Scalar mass matrix (N, N): integral of weight * phi_i * phi_j, consistent (not lumped).

    weight: rho * thickness (kg/m2) in 2-D, rho (kg/m3) in 3-D, for the mass of one displacement
    component; times the specific heat (J/(kg K)) for the heat capacity (J/K). cells: numbers of the
    cells to integrate over, None for all.
    """
    from sparsemor.bodies.fem import forms

    return forms.matrix(forms.mass, mesh, 2, cells=cells, weight=weight)


def capacity(
    mesh: Mesh, rho: float, c: float, thickness: float = 1.0, cells: IntArray | None = None
) -> Csr:
    """Heat capacity matrix (N, N), J/K: integral of rho c phi_i phi_j. thickness in m, 1 in 3-D."""
    return scalar_mass(mesh, rho * c * thickness, cells)


def lumped(matrix: Csr) -> Csr:
    """Lumped matrix (N, N): row sums of a mass or capacity matrix on the diagonal; the total is the
    same."""
    sums = np.asarray(matrix.sum(axis=1)).ravel()
    return csr_array(diags_array(sums))


def conductivity(
    mesh: Mesh, k: float | FloatArray, thickness: float = 1.0, cells: IntArray | None = None
) -> Csr:
    """Conductivity matrix (N, N), W/K: integral of k grad phi_i . grad phi_j, k a number or a
    tensor (d, d). thickness in m, 1 in 3-D."""
    from sparsemor.bodies.fem import forms

    return forms.matrix(forms.conduction, mesh, 0, cells=cells, weight=k * thickness)
