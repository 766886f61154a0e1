"""Weak forms of a thermoelastic body in scikit-fem notation, for any dimension.

    mass        w u v                   stiffness  lam div u div v + 2 mu eps(u) : eps(v)
    conduction  w grad u . grad v       expansion  w T div v
    flux        w v on facets           normal     w v . n on facets

u, v: trial and test functions, scalar (temperature, one displacement component) or vector with the
unknown number d * node + component. Import this module only for assembly: the import of scikit-fem
takes longer than reading a scene.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import skfem
from scipy.sparse import csr_array, diags_array
from skfem.helpers import ddot, div, dot, grad, sym_grad
from skfem.quadrature import get_quadrature

from sparsemor.core import BoolArray, Csr, FloatArray, IntArray, Mesh

CHUNK = 1 << 15
"""Number of linear cells assembled at a time, which limits additional memory to about 100 MB; a
quarter as many quadratic ones."""
ROUND_OFF = 1e-14
"""Entries no larger than this, relative to the largest of their row and column, are cancelled sums.
"""
_MESHES = {2: skfem.MeshTri, 3: skfem.MeshTet}
_ELEMENTS = {(2, 1): skfem.ElementTriP1, (3, 1): skfem.ElementTetP1,
             (2, 2): skfem.ElementTriP2, (3, 2): skfem.ElementTetP2}
"""Scalar elements by dimension and order. Numbers of unknowns are those of the nodes, because
midpoints are numbered as scikit-fem numbers edges (`edges`)."""
_FACET_EDGES = {2: np.array([[0, 1]]), 3: np.array([[0, 1], [1, 2], [0, 2]])}
"""Local corners of the edges of a facet, by dimension."""


def mass(u: Any, v: Any, w: Any) -> Any:
    return w.weight * u * v


def conduction(u: Any, v: Any, w: Any) -> Any:
    return w.weight * dot(grad(u), grad(v))


def stiffness(u: Any, v: Any, w: Any) -> Any:
    return w.lam * div(u) * div(v) + 2 * w.mu * ddot(sym_grad(u), sym_grad(v))


def expansion(temperature: Any, v: Any, w: Any) -> Any:
    return w.weight * temperature * div(v)


def flux(v: Any, w: Any) -> Any:
    return w.weight * v


def normal(v: Any, w: Any) -> Any:
    return w.weight * dot(v, w.n)


def matrix(
    form: Any, mesh: Mesh, order: int, *, rows: bool = False, columns: bool = False,
    cells: IntArray | None = None, **weights: float,
) -> Csr:
    """Matrix of a bilinear form on all cells, or on those with the given numbers; order: degree of
    the integrand with linear elements, for which it is exact; so it is with quadratic ones.

    rows, columns: the test or trial function is a vector: d N unknowns instead of N. Entries that
    cancel to round-off are dropped, so that a symmetric form has a symmetric pattern.
    """
    d, n = mesh.dimension, len(mesh.points)
    shape = (d * n if rows else n, d * n if columns else n)
    whole = csr_array(shape)
    for part in _chunks(form, mesh, order, rows, columns, cells, weights):
        chunk = csr_array(part.tocsr())
        chunk.sum_duplicates()
        chunk.eliminate_zeros()
        chunk.resize(shape)  # scikit-fem stops at the last point that a cell uses
        whole = chunk if not whole.nnz else whole + chunk
    return _without_round_off(whole)


def elements(
    form: Any, mesh: Mesh, order: int, *, rows: bool = False, columns: bool = False,
    cells: IntArray | None = None, **weights: float,
) -> FloatArray:
    """(E, p, q) element matrices of a bilinear form on all cells, or on those with the given
    numbers; unknown number is d * node + component for vectors, with the nodes of a cell in the
    order of `mesh.nodes`."""
    d, nodes = mesh.dimension, mesh.nodes.shape[1]
    p, q = (nodes * d if vector else nodes for vector in (rows, columns))
    return np.concatenate([  # scikit-fem keeps its entries by trial, test function and cell
        part.data.reshape(q, p, -1).transpose(2, 1, 0)
        for part in _chunks(form, mesh, order, rows, columns, cells, weights)])


def facet_matrix(form: Any, mesh: Mesh, facets: IntArray, **weights: float) -> Csr:
    """(N, N) matrix of a scalar bilinear form on boundary facets (F, d) of point numbers.

    Entries of other points are round-off and are dropped.
    """
    basis = _facet_basis(mesh, facets, vector=False)
    whole = csr_array(skfem.BilinearForm(form).assemble(basis, **weights))
    whole.resize((len(mesh.points), len(mesh.points)))
    here = diags_array(_on(mesh, facets).astype(float))
    kept = csr_array(here @ whole @ here)
    kept.sum_duplicates()
    kept.eliminate_zeros()
    return kept


def facet_vector(
    form: Any, mesh: Mesh, facets: IntArray, *, vector: bool = False, **weights: float
) -> FloatArray:
    """(N,) or, for vectors, (N, d) linear form on boundary facets (F, d) of point numbers; zero at
    all other points."""
    basis = _facet_basis(mesh, facets, vector)
    values = skfem.LinearForm(form).assemble(basis, **weights)
    whole = np.zeros(len(mesh.points) * (mesh.dimension if vector else 1))
    whole[:len(values)] = values
    whole[~np.repeat(_on(mesh, facets), mesh.dimension if vector else 1)] = 0.0
    return whole.reshape(-1, mesh.dimension) if vector else whole


def _without_round_off(A: Csr) -> Csr:
    """A (m, n) without entries |A_ij| <= ROUND_OFF sqrt(max_k |A_ik| max_k |A_kj|)."""
    size = abs(A)
    by_row, by_column = (np.sqrt(size.max(axis=axis).toarray()) for axis in (1, 0))
    size.data /= np.repeat(by_row, np.diff(A.indptr))
    size.data /= by_column[A.indices]
    A.data[size.data <= ROUND_OFF] = 0.0
    A.eliminate_zeros()
    return A


def edges(mesh: Mesh) -> tuple[IntArray, IntArray]:
    """Edges of a mesh: corners (M, 2), and (E, 3 or 6) numbers of the edges of each cell, (0, 1),
    (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)."""
    whole = _mesh(mesh)
    ends, of = (whole.facets, whole.t2f) if mesh.dimension == 2 else (whole.edges, whole.t2e)
    return np.asarray(ends.T, np.int64), np.asarray(of.T, np.int64)


def _on(mesh: Mesh, facets: IntArray) -> BoolArray:
    """(N,) True for nodes of the facets."""
    found: BoolArray = np.zeros(len(mesh.points), dtype=np.bool_)
    found[facets] = True
    if mesh.order == 2:
        ends, corners = np.sort(edges(mesh)[0], axis=1), len(mesh.corners)
        sides = facets[:, _FACET_EDGES[mesh.dimension]].reshape(-1, 2)
        keys, sought = (a @ np.array([corners, 1]) for a in (ends, np.sort(sides, axis=1)))
        found[corners:] = np.isin(keys, sought)
    return found


def _chunks(
    form: Any, mesh: Mesh, order: int, rows: bool, columns: bool, cells: IntArray | None,
    weights: dict[str, float],
) -> Iterator[Any]:
    whole, chosen = _mesh(mesh), np.arange(len(mesh.cells)) if cells is None else cells
    some = CHUNK // mesh.order**2
    for start in range(0, len(chosen), some):
        scalar = skfem.Basis(whole, _element(mesh), intorder=max(_degree(mesh, order), 1),
                             elements=chosen[start : start + some])
        vector = scalar.with_element(skfem.ElementVector(_element(mesh)))
        trial, test = (vector if columns else scalar), (vector if rows else scalar)
        yield skfem.BilinearForm(form).coo_data(trial, test, **weights)


def _element(mesh: Mesh) -> Any:
    return _ELEMENTS[mesh.dimension, mesh.order]()


def _degree(mesh: Mesh, degree: int) -> int:
    """Degree of an integrand on this mesh that has the given one with linear elements: each of two
    shape functions, or their gradients, has one more with quadratic elements."""
    return degree if mesh.order == 1 else max(degree + 2, 2 * degree)


def cell_basis(
    mesh: Mesh, order: int, cells: IntArray | None = None, at_nodes: bool = False,
    positive: bool = False,
) -> Any:
    """Scalar scikit-fem basis on all cells, or on those with the given numbers; order: degree of
    the integrand with linear elements, for which the quadrature is exact; so it is with quadratic
    ones. at_nodes: the points are the nodes of the cell, with equal weights; positive: all weights
    are, by a higher degree where they would not be."""
    whole, element, degree = _mesh(mesh), _element(mesh), _degree(mesh, order)
    while positive and not (get_quadrature(element.refdom, degree)[1] > 0.0).all():
        degree += 1
    chosen = np.arange(len(mesh.cells)) if cells is None else cells
    if degree > 1 and not at_nodes:
        return skfem.Basis(whole, element, intorder=degree, elements=chosen)
    points = np.array(element.doflocs).T
    if not at_nodes:  # one point is exact for linear integrands; scikit-fem takes three or more
        points = points.mean(axis=1, keepdims=True)
    count = points.shape[1]
    weights = np.full(count, 1.0 / (math.factorial(mesh.dimension) * count))
    return skfem.Basis(whole, element, elements=chosen, quadrature=(points, weights))


def facet_basis(mesh: Mesh, facets: IntArray, degree: int) -> Any:
    """Scalar scikit-fem basis on boundary facets (F, d) of corner numbers, in their order, with
    quadrature that is exact for integrands of this degree with linear elements, and for theirs with
    quadratic ones."""
    return _facet_basis(mesh, facets, False, degree)


def _mesh(mesh: Mesh) -> Any:
    return _MESHES[mesh.dimension](
        np.ascontiguousarray(mesh.corners.T), np.ascontiguousarray(mesh.cells.T), sort_t=False)


def _facet_basis(mesh: Mesh, facets: IntArray, vector: bool, degree: int = 2) -> Any:
    """scikit-fem basis on given boundary facets, identified by their sorted points."""
    whole, wanted = _mesh(mesh), np.sort(facets, axis=1)
    own = whole.facets.T
    keys, sought = (np.ravel_multi_index(a.T, (len(mesh.corners),) * mesh.dimension)
                    for a in (own, wanted))
    order = np.argsort(keys)
    found = order[np.searchsorted(keys, sought, sorter=order)]
    element = _element(mesh)
    return skfem.FacetBasis(
        whole, skfem.ElementVector(element) if vector else element, facets=found,
        intorder=_degree(mesh, degree))
