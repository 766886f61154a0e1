"""Integrals over cells and boundary facets: scalar matrices and nodal loads.

A facet is a row of corner numbers, ordered for an outward normal; where some have four corners,
those of three repeat the last.
"""

import numpy as np
from scipy.sparse import csr_array, diags_array

from sparsemor.bodies.fem.quadrature import Quadrature
from sparsemor.core import Csr, FloatArray, InputError, IntArray, Mesh
from sparsemor.core.model.facets import cell_facets, facet_numbers, linear_facets, rows_among


def on_cells(
    mesh: Mesh, degree: int, cells: IntArray | None = None, *, gradients: bool = True,
    at_nodes: bool = False, positive: bool = False,
) -> list[tuple[IntArray, Quadrature]]:
    """Quadrature of the cells of each kind (all, or those with the given numbers), with their
    positions among them; exact for polynomials of this degree. at_nodes: points at the nodes with
    the weights of lumped matrices; positive: without negative weights."""
    from sparsemor.bodies.fem import element_matrices

    return element_matrices.cell_quadratures(mesh, degree, cells, gradients, at_nodes, positive)


def scalar_mass(mesh: Mesh, weight: float, cells: IntArray | None = None) -> Csr:
    """Scalar mass matrix (N, N): integral of weight * phi_i * phi_j, consistent (not lumped).

    weight: rho * thickness (kg/m2) in 2-D, rho (kg/m3) in 3-D, for the mass of one displacement
    component; times the specific heat (J/(kg K)) for the heat capacity (J/K). cells: numbers of the
    cells to integrate over, None for all.
    """
    from sparsemor.bodies.fem import element_matrices

    return element_matrices.matrix(element_matrices.mass, mesh, 2, cells=cells, weight=weight)


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
    from sparsemor.bodies.fem import element_matrices

    return element_matrices.matrix(
        element_matrices.conduction, mesh, 0, cells=cells, weight=k * thickness)


def boundary_facets(mesh: Mesh, nodes: IntArray, name: str = "") -> IntArray:
    """(F, w) boundary facets of the set of that name with the points `nodes`, ordered for outward
    normals (`set_facets`).

    InputError when there are none: the set is inside the body, or a single point.
    """
    facets = set_facets(mesh, nodes, name)
    if not len(facets):
        kind = "edge" if mesh.dimension == 2 else "face"
        if name in mesh.facet_sets:
            raise InputError(
                f"all {len(mesh.facet_sets[name])} {kind}s of this set lie inside the body, "
                f"between two of its cells: name a set that covers a piece of the surface")
        raise InputError(
            f"none of the body's boundary {kind}s has all its points among the {len(nodes)} "
            f"points of this set: name a set that covers a piece of the surface"
        )
    return facets


def set_facets(mesh: Mesh, nodes: IntArray, name: str = "") -> IntArray:
    """(F, w) boundary facets of a set, ordered for outward normals, possibly none.

    Those that the mesh tags with the name; else those of the cells that it tags, and of any cell
    where it tags none, with all points in `nodes`. A boundary facet belongs to one cell only.
    number, count: number of each facet of each cell among the different ones, and how many cells
    have it.
    """
    facets, owner = cell_facets(mesh.cells, mesh.dimension)
    number, count = facet_numbers(facets)
    outer = count[number] == 1
    if name in mesh.cell_sets and name not in mesh.facet_sets:
        tagged = np.zeros(len(mesh.cells), dtype=np.bool_)
        tagged[mesh.cell_sets[name]] = True
        outer &= tagged[owner]
    facets = facets[outer]
    return np.asarray(facets[
        rows_among(facets, mesh.facet_sets[name]) if name in mesh.facet_sets
        else np.isin(facets, nodes).all(axis=1)])


def divided(mesh: Mesh, facets: IntArray) -> IntArray:
    """(S, d) segments or triangles between the nodes of boundary facets (F, w): two triangles of a
    quadrilateral, and twice (in space, four times) as many with cells of second order."""
    rows, of = linear_facets(mesh.nodes, mesh.dimension)
    chosen = rows_among(cell_facets(mesh.cells, mesh.dimension)[0], facets)
    return np.asarray(rows[chosen[of]])


def area_vectors(corners: FloatArray) -> FloatArray:
    """(F, d) outward normals of facets with corners (F, d, d), m, of length (d - 1)! times the
    facet's measure, m or m2.

    In the plane the body is on the left of a segment, in space corners run counter-clockwise seen
    from outside.
    """
    side = corners[:, 1:] - corners[:, :1]
    if corners.shape[2] == 2:
        return np.stack([side[:, 0, 1], -side[:, 0, 0]], axis=1)
    return np.cross(side[:, 0], side[:, 1])


def facet_measures(mesh: Mesh, facets: IntArray) -> FloatArray:
    """(F,) length (m) or area (m2) of each facet."""
    from sparsemor.bodies.fem import element_matrices

    found = np.zeros(len(facets))
    for here, at, _ in element_matrices.facet_quadratures(mesh, facets, 1):
        found[here] = at.weights.sum(axis=1)
    return found


def surface_load(mesh: Mesh, facets: IntArray, thickness: float = 1.0) -> FloatArray:
    """(N,) integral of phi_i over the facets, m2. Times a flux (W/m2) it is nodal heat (W)."""
    from sparsemor.bodies.fem import element_matrices

    return thickness * element_matrices.facet_vector(mesh, facets)


def surface_normal_load(mesh: Mesh, facets: IntArray, thickness: float = 1.0) -> FloatArray:
    """(N, d) integral of phi_i n, m2, n outward. Times minus a pressure (Pa) it is nodal forces
    (N)."""
    from sparsemor.bodies.fem import element_matrices

    return thickness * element_matrices.facet_vector(mesh, facets, normal=True)


def surface_mass(mesh: Mesh, facets: IntArray, weight: float) -> Csr:
    """(N, N) integral of weight phi_i phi_j over the facets.

    weight: film coefficient (W/(m2 K)) * thickness (m, 1 in 3-D) gives a convection matrix, W/K.
    """
    from sparsemor.bodies.fem import element_matrices

    return element_matrices.facet_matrix(mesh, facets, weight)


def on_facets(
    mesh: Mesh, facets: IntArray, degree: int, *, gradients: bool = False
) -> list[Quadrature]:
    """Quadrature of the facets (F, w) of each shape, rows of corner numbers, exact for polynomials
    of this degree."""
    from sparsemor.bodies.fem import element_matrices

    return [at for _, at, _ in element_matrices.facet_quadratures(mesh, facets, degree, gradients)]
