"""Boundary facets of simplices, and integrals over them.

A facet is a row of d corner numbers, ordered for an outward normal.
"""

import numpy as np

from sparsemor.bodies.mesh.simplices import rows_among
from sparsemor.core import Csr, FloatArray, InputError, IntArray, Mesh
from sparsemor.core.model.facets import cell_facets, facet_numbers


def boundary_facets(mesh: Mesh, nodes: IntArray, name: str = "") -> IntArray:
    """(F, d) boundary facets of the set of that name with the points `nodes`, ordered for outward
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
    """(F, d) boundary facets of a set, ordered for outward normals, possibly none.

    Those that the mesh tags with the name; else those of the cells that it tags, and of any cell
    where it tags none, with all points in `nodes`.
    """
    number, count = facet_numbers(mesh.cells)
    outer = count[number] == 1
    if name in mesh.cell_sets and name not in mesh.facet_sets:
        tagged = np.zeros(len(mesh.cells), dtype=np.bool_)
        tagged[mesh.cell_sets[name]] = True
        outer &= np.repeat(tagged, mesh.dimension + 1)
    facets = cell_facets(mesh.cells)[outer]
    return np.asarray(facets[
        rows_among(facets, mesh.facet_sets[name]) if name in mesh.facet_sets
        else np.isin(facets, nodes).all(axis=1)])


def facet_normals(mesh: Mesh, facets: IntArray) -> FloatArray:
    """(F, d) outward normals whose length is the facet's measure, m (2-D) or m2 (3-D)."""
    sides = mesh.points[facets[:, 1:]] - mesh.points[facets[:, :1]]
    if mesh.dimension == 2:
        return np.stack([sides[:, 0, 1], -sides[:, 0, 0]], axis=1)
    return np.asarray(np.cross(sides[:, 0], sides[:, 1]) / 2)


def facet_measures(mesh: Mesh, facets: IntArray) -> FloatArray:
    """(F,) length (m) or area (m2) of each facet."""
    return np.asarray(np.linalg.norm(facet_normals(mesh, facets), axis=1))


def surface_load(mesh: Mesh, facets: IntArray, thickness: float = 1.0) -> FloatArray:
    """(N,) integral of phi_i over the facets, m2. Times a flux (W/m2) it is nodal heat (W)."""
    from sparsemor.bodies.fem import forms

    return forms.facet_vector(forms.flux, mesh, facets, weight=thickness)


def surface_normal_load(mesh: Mesh, facets: IntArray, thickness: float = 1.0) -> FloatArray:
    """(N, d) integral of phi_i n, m2, n outward. Times minus a pressure (Pa) it is nodal forces
    (N)."""
    from sparsemor.bodies.fem import forms

    return forms.facet_vector(forms.normal, mesh, facets, vector=True, weight=thickness)


def surface_mass(mesh: Mesh, facets: IntArray, weight: float) -> Csr:
    """(N, N) integral of weight phi_i phi_j over the facets.

    weight: film coefficient (W/(m2 K)) * thickness (m, 1 in 3-D) gives a convection matrix, W/K.
    """
    from sparsemor.bodies.fem import forms

    return forms.facet_matrix(forms.mass, mesh, facets, weight=weight)
