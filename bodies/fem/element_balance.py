"""Internal force and heat balance of a body per element, for hyper-reduction by element weights."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sparsemor.bodies.fem.elasticity import expansion_weight, stiffness_form
from sparsemor.bodies.fem.field_matrices import HasFields, Heat, numbered
from sparsemor.core import Amplitude, FloatArray, IntArray, Mesh
from sparsemor.core.protocols.separable import ElasticIntegrals, HeatIntegrals, Integrals


def elastic_integrals(body: HasFields) -> ElasticIntegrals:
    """Element integrals of the internal forces, N, on the free displacements: stiffness, thermal
    coupling, and vectors of given temperatures (first the constant one, here of the reference
    temperatures, then one per amplitude). Their sum is that of `body_terms.write_elasticity`.

    Internal force: stiffness u - coupling T - given [1; amplitudes(t)]. K, Kt: element matrices (E,
    q d, q d) and (E, q d, q); rows, nodes: number among the free unknowns of each of their rows and
    columns, -1 for none. Without temperature unknowns the constant vector is that of T0 - T_ref.
    """
    from sparsemor.bodies.fem import element_matrices

    e, mesh, t = body.elasticity, body.mesh, body.thickness
    assert e is not None and mesh is not None
    K = _by_region(mesh, [(cells, element_matrices.elements(
        form, mesh, 0, rows=True, columns=True, cells=cells, **weights))
        for cells, law in e.regions for form, weights in [stiffness_form(law, t)]])
    Kt = _by_region(mesh, [(cells, element_matrices.elements(
        element_matrices.expansion, mesh, 1, rows=True, cells=cells,
        weight=expansion_weight(law, t)))
        for cells, law in e.regions])
    n = len(e.free)
    d = mesh.dimension
    # mesh.nodes (E, q): node numbers of each element; unknown number d * node + component
    dofs = d * mesh.nodes[:, :, None] + np.arange(d)
    rows = numbered(e.free, d * len(mesh.points))[dofs.reshape(len(mesh.cells), -1)]
    assert body.T0 is not None and body.T_ref is not None
    stiffness = Integrals(rows, rows, K, (n, n))
    if body.heat is None:
        vectors = [_element_products(Kt, mesh, body.T0 - body.T_ref)]
        return ElasticIntegrals(
            stiffness, coupling=None, given=_columns(rows, n, vectors), amplitudes=())
    nodes = numbered(body.heat.free, len(mesh.points))[mesh.nodes]
    vectors, amplitudes = [-_element_products(Kt, mesh, body.T_ref)], []
    for held, function, shape in body.heat.prescribed:
        vectors.append(_element_products(Kt, mesh, _nodal(mesh, held, shape)))
        amplitudes.append(function.value)
    coupling = Integrals(rows, nodes, Kt, (n, len(body.heat.free)))
    return ElasticIntegrals(stiffness, coupling, _columns(rows, n, vectors), tuple(amplitudes))


def heat_integrals(body: HasFields) -> HeatIntegrals:
    """Element integrals of the heat balance, W, of the free temperatures: capacity, conductivity,
    and vectors of prescribed temperatures. Their sum is that of `body_terms.write_conduction`:
    capacity T' + conductivity T - given [1; amplitudes(t)]. h.regions: cells of each material with
    the weights rho c thickness and k thickness; nodes: number of each node of the cells among the
    free temperatures, -1 for none."""
    from sparsemor.bodies.fem import element_matrices

    h, mesh = body.heat, body.mesh
    assert h is not None and mesh is not None
    C = _by_region(mesh, [(cells, element_matrices.elements(
        element_matrices.mass, mesh, 2, cells=cells, weight=stored))
        for cells, (stored, _) in h.regions])
    if h.lumped:  # row sums on the diagonal
        C = C.sum(axis=2)[:, :, None] * np.eye(C.shape[1])
    K = _by_region(mesh, [(cells, element_matrices.elements(
        element_matrices.conduction, mesh, 0, cells=cells, weight=conducted))
        for cells, (_, conducted) in h.regions])
    n = len(h.free)
    nodes = numbered(h.free, len(mesh.points))[mesh.nodes]
    vectors, amplitudes = _prescribed(h, mesh, C, K)
    return HeatIntegrals(
        Integrals(nodes, nodes, C, (n, n)), Integrals(nodes, nodes, K, (n, n)),
        _columns(nodes, n, vectors), amplitudes)


def _by_region(
    mesh: Mesh, parts: Sequence[tuple[IntArray | None, FloatArray]]
) -> FloatArray:
    """Element matrices (E, p, q) of all cells, from those of each region."""
    if len(parts) == 1:
        return parts[0][1]
    found = np.zeros((len(mesh.cells), *parts[0][1].shape[1:]))
    for cells, values in parts:
        found[cells] = values
    return found


def _prescribed(
    h: Heat, mesh: Mesh, C: FloatArray, K: FloatArray
) -> tuple[list[FloatArray], tuple[Amplitude, ...]]:
    """Element vectors (E, p), W, of the effect of prescribed temperatures shape * f(t) on the
    right-hand side of the rows of their elements, and the functions of time that multiply them.

    First the constant vector, here zero, then for each of them -K shape with f and -C shape with
    f'. C, K: element matrices (E, p, p) of capacity, J/K, and conductivity, W/K. Rows of the
    prescribed temperatures themselves have no number (`numbered`), and so no effect.
    """
    vectors, amplitudes = [np.zeros(mesh.nodes.shape)], []
    for held, function, shape in h.prescribed:
        nodal = _nodal(mesh, held, shape)
        vectors += [-_element_products(K, mesh, nodal), -_element_products(C, mesh, nodal)]
        amplitudes += [function.value, function.rate]
    return vectors, tuple(amplitudes)


def _nodal(mesh: Mesh, nodes: IntArray, shape: FloatArray) -> FloatArray:
    """Values (N,) of all nodes of a mesh: `shape` (n,) at some nodes (n,), 0 elsewhere."""
    values = np.zeros(len(mesh.points))
    values[nodes] = shape
    return values


def _element_products(matrices: FloatArray, mesh: Mesh, nodal: FloatArray) -> FloatArray:
    """(E, p) products of element matrices (E, p, q) with nodal values (N,)."""
    return np.asarray(np.einsum("epc,ec->ep", matrices, nodal[mesh.nodes]))


def _columns(rows: IntArray, n: int, vectors: Sequence[FloatArray]) -> Integrals:
    """Element integrals of shape (n, j) with j vectors (E, p) as columns; rows (E, p): matrix row
    of each entry."""
    columns = np.broadcast_to(np.arange(len(vectors)), (len(rows), len(vectors)))
    return Integrals(rows, columns, np.stack(vectors, axis=2), (n, len(vectors)))
