"""Element matrices of a thermoelastic body from scikit-fem's elements, for all kinds of cells.

    mass        w u v                   stiffness  lam div u div v + 2 mu eps(u) : eps(v)
    conduction  w grad u . grad v       expansion  w T div v

Of the section of a body of revolution (`Mesh.revolved`) the weights are those of the full turn, 2
pi x, and displacements have the hoop strain u_x / x, with `hoop_stiffness` and `hoop_expansion`.

u, v: trial and test functions, scalar (temperature, one displacement component) or vector with the
unknown number d * node + component. Numbers of unknowns are those of the nodes of the mesh. Cells
are mapped by their own shape functions (isoparametric), triangles and tetrahedra with straight
edges by an affine map. Import this module only for assembly: the import of scikit-fem takes longer
than reading a scene.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
import skfem
from scipy.sparse import csr_array
from skfem.element.element_h1 import ElementH1
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine, RefQuad, RefTri, RefWedge

from sparsemor.bodies.fem.quadrature import Quadrature, ShapeFunctions, from_basis
from sparsemor.core import BoolArray, Csr, FloatArray, IntArray, Mesh
from sparsemor.core.model.facets import cell_facets, facet_keys, group_equal_rows
from sparsemor.core.protocols.cells import KINDS, CellKind, corners_of

CHUNK = 5_000_000
"""Number of entries of element matrices that are assembled at a time, about 40 MB."""
ROUND_OFF = 1e-14
"""Entries no larger than this, relative to the largest of their row and column, are cancelled sums.
"""
STRAIGHT = 1e-13
"""Distance of a node from the middle of its edge, relative to coordinates, that is round-off."""


class ElementWedge2(ElementH1):  # type: ignore[misc]
    """Wedge of second order with 18 nodes: products of quadratic functions of the triangle and of
    the height, which scikit-fem does not have. lbasis (scikit-fem's interface): function i and its
    gradient at points X (3, Q) of the reference cell; maxdeg: its degree; doflocs: its nodes."""

    maxdeg: ClassVar[int] = 4
    refdom = RefWedge
    doflocs = KINDS[3, 6].nodes
    _pairs: ClassVar[list[tuple[int, int]]] = [
        (next(i for i, y in enumerate(KINDS[2, 3].nodes) if np.array_equal(y, x[:2])),
         (0.0, 1.0, 0.5).index(x[2])) for x in KINDS[3, 6].nodes]
    """Node of the quadratic triangle and of the line (ends, middle) of each node."""

    def lbasis(self, X: FloatArray, i: int) -> tuple[FloatArray, FloatArray]:
        flat, up = self._pairs[i]
        f, df = skfem.ElementTriP2().lbasis(X[:2], flat)
        g, dg = skfem.ElementLineP2().lbasis(X[2:], up)
        return f * g, np.array([df[0] * g, df[1] * g, f * dg[0]])


@dataclass(repr=False)
class _MeshWedge2(skfem.MeshWedge1):  # type: ignore[misc]
    elem: Any = ElementWedge2


_GRIDS: dict[tuple[int, int], Any] = {
    (2, 3): skfem.MeshTri, (2, 6): skfem.MeshTri2, (2, 4): skfem.MeshQuad, (2, 9): skfem.MeshQuad2,
    (3, 4): skfem.MeshTet, (3, 10): skfem.MeshTet2, (3, 6): skfem.MeshWedge1, (3, 18): _MeshWedge2,
    (3, 8): skfem.MeshHex, (3, 27): skfem.MeshHex2}
"""scikit-fem's meshes by dimension and number of nodes of a cell."""


class _Numbers(NamedTuple):
    """Numbers of the unknowns of each cell (q, E), and of all unknowns: instead of scikit-fem's."""

    element_dofs: IntArray
    N: int


class Space(NamedTuple):
    """Cells of one kind. element: scikit-fem's, of the order of the mesh; to_ours (q,): positions
    of our nodes in its order, ours (q,): the reverse; curved: True where some edge is not straight.
    """

    kind: CellKind
    order: int
    element: Any
    to_ours: IntArray
    ours: IntArray
    curved: bool

    @classmethod
    def on_mesh(cls, mesh: Mesh, nodes: IntArray) -> "Space":
        """Space on cells with the given nodes (n, q)."""
        d, q = mesh.dimension, nodes.shape[1]
        kind = KINDS[d, corners_of(d, q)]
        element = _GRIDS[d, q].elem()
        away = np.abs(kind.nodes[:q, None] - element.doflocs).sum(axis=2)
        to_ours = away.argmin(axis=1)
        return cls(kind, mesh.order, element, to_ours, np.argsort(to_ours),
                   mesh.order == 2 and bool(_curved(mesh, kind, nodes).any()))

    @property
    def simplex(self) -> bool:
        return len(self.kind.turns) == 1

    def grid(self, mesh: Mesh, nodes: IntArray) -> Any:
        """scikit-fem's mesh of the cells with the given nodes (n, q)."""
        d, p, points = mesh.dimension, len(self.kind.places), np.ascontiguousarray(mesh.points.T)
        affine = self.simplex and not self.curved
        own = nodes[:, self.ours]
        corners = np.ascontiguousarray(own[:, :p].T)
        made = _GRIDS[d, p if affine else nodes.shape[1]](points, corners, sort_t=False,
                                                          validate=False)
        made._dofs = _Numbers(own.T, len(mesh.points))
        return made

    def basis(self, mesh: Mesh, nodes: IntArray, rule: tuple[FloatArray, FloatArray]) -> Any:
        """Scalar scikit-fem basis on cells with the given nodes (n, q), at the points and weights
        of a quadrature rule."""
        return skfem.Basis(self.grid(mesh, nodes), self.element, quadrature=rule,
                           dofs=_Numbers(nodes[:, self.ours].T, len(mesh.points)),
                           disable_doflocs=True)

    def degree(self, degree: int) -> int:
        """Degree of an integrand in these cells that has the given one with linear triangles: each
        of two shape functions, or their gradients, has one more with quadratic ones, and a curved
        map adds to it; in wedges and hexahedra that along each axis."""
        if self.simplex:
            return degree if self.order == 1 else max(degree + 2, 2 * degree) + 2 * self.curved
        return self.order * max(2, degree) + 1

    def rule(self, degree: int) -> tuple[FloatArray, FloatArray]:
        """Points (d, Q) and weights (Q,) in the reference cell for an integrand that has the given
        degree with linear triangles."""
        return rule(self.element.refdom, self.degree(degree))


def folded(mesh: Mesh) -> IntArray:
    """Numbers of the cells, other than straight triangles and tetrahedra, whose map has a
    determinant that is not positive at a node or quadrature point."""
    found = [np.zeros(0, np.int64)]
    for here, nodes, space in spaces(mesh):
        if space.curved or not space.simplex:
            at = np.hstack([np.array(space.element.doflocs).T, space.rule(0)[0], space.rule(2)[0]])
            DF = space.grid(mesh, nodes)._mapping().DF(at)
            found.append(here[(np.linalg.det(DF.transpose(2, 3, 0, 1)) <= 0.0).any(axis=1)])
    return np.sort(np.concatenate(found))


def rule(refdom: Any, degree: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights of scikit-fem's quadrature of a reference cell, exact for this degree."""
    if refdom is not RefWedge:
        return get_quadrature(refdom, max(degree, 1))  # type: ignore[no-any-return]
    (x, v), (z, w) = (get_quadrature(r, degree) for r in (RefTri, RefLine))
    return (np.vstack([np.repeat(x, z.shape[1], axis=1), np.tile(z, x.shape[1])]),
            np.outer(v, w).ravel())


def _curved(mesh: Mesh, kind: CellKind, nodes: IntArray) -> BoolArray:
    """(n,) True for cells with nodes (n, q) of which a further one is not the mean of its corners.
    """
    X, p = mesh.points, len(kind.places)
    bent: BoolArray = np.zeros(len(nodes), np.bool_)
    for i, corners in enumerate(kind.further, p):
        away = np.abs(X[nodes[:, i]] - X[nodes[:, list(corners)]].mean(axis=1))
        bent |= (away > STRAIGHT * np.abs(X).max()).any(axis=1)
    return bent


def _parts(mesh: Mesh, cells: IntArray | None) -> Iterator[tuple[IntArray, IntArray]]:
    """Positions in `cells` (numbers, all if None) of the cells of each kind, and their nodes (n, q)
    in the order of the mesh; one pair for each kind. mesh.parts: the same for all cells."""
    for here, nodes in mesh.parts:
        if cells is None:
            yield here, nodes
            continue
        at = np.full(len(mesh.cells), -1)
        at[here] = np.arange(len(here))
        mine = np.flatnonzero(at[cells] >= 0)
        if len(mine):
            yield mine, nodes[at[cells[mine]]]


def spaces(mesh: Mesh, cells: IntArray | None = None) -> Iterator[tuple[IntArray, IntArray, Space]]:
    """Positions in `cells` (numbers, all if None) of the cells of each kind, straight triangles and
    tetrahedra apart from curved ones, their nodes (n, q) in the order of the mesh, and their space.
    """
    for here, nodes in _parts(mesh, cells):
        space = Space.on_mesh(mesh, nodes)
        if not (space.curved and space.simplex):
            yield here, nodes, space
            continue
        bent = _curved(mesh, space.kind, nodes)
        for mine, curved in ((~bent, False), (bent, True)):
            if mine.any():
                yield here[mine], nodes[mine], space._replace(curved=curved)


def cell_quadratures(
    mesh: Mesh, degree: int, cells: IntArray | None = None, gradients: bool = True,
    at_nodes: bool = False, positive: bool = False,
) -> list[tuple[IntArray, Quadrature]]:
    """Positions in `cells` (numbers, all if None) of the cells of each kind, and their quadrature.

    degree: of the integrand with linear triangles or tetrahedra, for which it is exact with
    straight edges of either order. at_nodes: the points are the nodes of the cell, with the
    integrals of their shape functions as weights; positive: all weights are, by a higher degree
    where they would not be. Of a body of revolution (`revolved`) weights have the factor 2 pi x.
    """
    found = []
    degree += mesh.revolved
    for here, nodes, space in spaces(mesh, cells):
        chosen = space.rule(degree)
        more = degree
        while positive and not (chosen[1] > 0.0).all():
            more += 1
            chosen = space.rule(more)
        nodal = np.array(space.element.doflocs).T
        if at_nodes:
            chosen = nodal, np.ones(nodal.shape[1])
        elif space.simplex and space.degree(degree) <= 1:
            # one point is exact for linear integrands; scikit-fem takes three or more
            chosen = nodal.mean(axis=1, keepdims=True), chosen[1].sum(keepdims=True)
        at = _turned(mesh, from_basis(space.basis(mesh, nodes, chosen), gradients))
        if at_nodes:
            whole = _turned(mesh, from_basis(
                space.basis(mesh, nodes, space.rule(1 + mesh.revolved)), gradients=False))
            at = replace(at, weights=(whole.shape.values * whole.weights[:, None]).sum(axis=2))
        found.append((here, at))
    return found


def facet_quadratures(
    mesh: Mesh, facets: IntArray, degree: int, gradients: bool = False
) -> list[tuple[IntArray, Quadrature, FloatArray]]:
    """Positions in `facets` (F, w), rows of corner numbers, of those of each shape; their
    quadrature, exact for integrands of this degree with linear triangles and tetrahedra and theirs
    with others of straight edges; outward unit normals (d, n, Q). Without gradients the nodes of a
    facet are its own, else those of its cell."""
    degree += mesh.revolved
    d, on_facets = mesh.dimension, np.zeros(len(mesh.points), np.bool_)
    on_facets[facets] = True
    near_cells = np.flatnonzero(np.count_nonzero(on_facets[mesh.cells], axis=1) >= d)
    # facets of the cells near by, kind by kind, and for each wanted one its row among them
    rows, owner = cell_facets(mesh.cells[near_cells], d)
    # rows of four corners in space, of triangles the last one twice
    wide = [np.pad(r, ((0, 0), (0, 4 - r.shape[1])), mode="edge") if d == 3 else r
            for r in (rows, facets)]
    group, first, _ = group_equal_rows(facet_keys(np.concatenate(wide)))
    row_of = first[group[len(rows):]]  # the first cell with this facet
    # (corners, nodes, points) of a facet -> positions, quadratures and normals
    shapes: dict[tuple[int, int, int], list[tuple[IntArray, Any, FloatArray]]] = {}
    start = 0  # row of the first facet of this kind of cells
    for here, nodes in _parts(mesh, near_cells):
        space = Space.on_mesh(mesh, nodes)
        count = len(space.kind.facets)
        for k, facet in enumerate(space.kind.facets):
            mine = np.flatnonzero((row_of >= start) & (row_of < start + len(here) * count)
                                  & ((row_of - start) % count == k))
            if len(mine):
                own = nodes[(row_of[mine] - start) // count]
                q, normals = _on_facet(mesh, space, own, facet, degree, gradients)
                key = len(facet), int(q.shape.nodes.shape[1]), int(q.weights.shape[1])
                shapes.setdefault(key, []).append((mine, q, normals))
        start += len(here) * count
    found = []
    for parts in shapes.values():
        mine = np.concatenate([m for m, _, _ in parts])
        order = np.argsort(mine, kind="stable")
        found.append((mine[order], Quadrature.joined([q for _, q, _ in parts], order),
                      np.concatenate([n for _, _, n in parts], axis=1)[:, order]))
    return found


def _on_facet(
    mesh: Mesh, space: Space, nodes: IntArray, facet: tuple[int, ...], degree: int, gradients: bool
) -> tuple[Quadrature, FloatArray]:
    """Quadrature and outward unit normals (d, n, Q) on the facet with these local corners, numbers
    0 to p - 1, of cells of `space` with the nodes (n, q); degree: of the integrand with linear
    triangles; gradients: those of the cell's shape functions too, with all its nodes."""
    d, corners = mesh.dimension, np.array([space.kind.places[i] for i in facet])
    refdom: Any = {2: RefLine, 3: RefTri, 4: RefQuad}[len(facet)]
    flat = space._replace(kind=KINDS[2, 3] if len(facet) < 4 else KINDS[2, 4])  # for its degree
    xi, weights = rule(refdom, flat.degree(degree))
    sides = (corners[[1, -1] if d == 3 else [1]] - corners[0]).T  # (d, d - 1)
    points = corners[0][:, None] + sides @ xi
    # numbers in the cell of the nodes of the facet: its corners, then those between some of them
    own = [*facet, *(i for i, c in enumerate(space.kind.further, len(space.kind.places))
                     if set(c) <= set(facet) and mesh.order == 2)]
    shapes = [space.element.lbasis(points, i) for i in space.to_ours[own]]
    X, phi = mesh.points[nodes[:, own]], np.array([f for f, _ in shapes])
    # derivatives along the sides of the facet, and from these its tangents and normal
    along = np.einsum("njq,jk->nkq", np.array([df for _, df in shapes]), sides)
    tangents = np.einsum("eni,nkq->kieq", X, along)
    normals = np.cross(tangents[0], tangents[1], axis=0) if d == 3 else np.stack(
        [tangents[0, 1], -tangents[0, 0]])
    size = np.linalg.norm(normals, axis=0)
    shape = ShapeFunctions(nodes[:, own], phi[None], None) if not gradients else (
        from_basis(space.basis(mesh, nodes, (points, weights))).shape)
    at = Quadrature(shape, size * weights, np.einsum("eni,nq->ieq", X, phi))
    return _turned(mesh, at), normals / size


def _turned(mesh: Mesh, at: Quadrature) -> Quadrature:
    """The quadrature, of the section of a body of revolution over its full turn."""
    return at if not mesh.revolved else replace(
        at, weights=2.0 * np.pi * at.coordinates[0] * at.weights)


# ---------------------------------------------------------------------- element matrices

def mass(at: Quadrature, weight: float) -> FloatArray:
    """Element matrices (E, n, n) of the integral of weight phi_i phi_j."""
    phi = at.shape.values
    return np.asarray((phi * (weight * at.weights)[:, None]) @ phi.transpose(0, 2, 1))


def conduction(at: Quadrature, weight: float | FloatArray) -> FloatArray:
    """Element matrices (E, n, n) of the integral of grad phi_i . weight grad phi_j, weight a number
    or a tensor (d, d)."""
    G, w = _gradients(at)
    n = G.shape[1]
    return np.asarray((_directed(weight, G) * w[:, None, None]).reshape(len(G), n, -1)
                      @ G.reshape(len(G), n, -1).transpose(0, 2, 1))


def stiffness(at: Quadrature, lam: float, mu: float) -> FloatArray:
    """Element matrices (E, n d, n d) of an isotropic law, by H_iajb = integral of d_a phi_i d_b
    phi_j: K_iajb = lam H_iajb + mu H_ibja + mu delta_ab sum_c H_icjc. lam, mu: times the thickness;
    G (E, n, d, Q): gradients, w (E, Q): weights, Q = 1 where gradients are constant in each
    cell."""
    G, w = _gradients(at)
    E, n, d, Q = G.shape
    flat = G.reshape(E, n * d, Q)
    H = ((flat * w[:, None]) @ flat.transpose(0, 2, 1)).reshape(E, n, d, n, d)
    K = lam * H + mu * H.transpose(0, 1, 4, 3, 2)
    trace = mu * np.einsum("eiaja->eij", H)
    for a in range(d):
        K[:, :, a, :, a] += trace
    return K.reshape(E, n * d, n * d)


def anisotropic(at: Quadrature, C: FloatArray) -> FloatArray:
    """Element matrices (E, n d, n d), integrals of B^T C B, of a material whose stiffness C (s, s),
    times the thickness, depends on the direction; B: strains xx, yy, zz, yz, zx, xy (in the plane
    xx, yy, xy) by nodal displacements, shear as angles, twice the tensor's components. G (E, n, d,
    Q): gradients, w (E, Q): weights."""
    G, w = _gradients(at)
    E, n, d, Q = G.shape
    pairs = [(0, 0), (1, 1), (0, 1)] if d == 2 else [
        (0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1)]
    B = np.zeros((E, len(pairs), n, d, Q))  # strains by displacements
    for m, (i, j) in enumerate(pairs):
        B[:, m, :, i] += G[:, :, j]
        if i != j:
            B[:, m, :, j] += G[:, :, i]
    flat = B.reshape(E, len(pairs), n * d, Q)
    return np.asarray(np.einsum(
        "etmq,ts,esnq->emn", flat, C, flat * w[:, None, None], optimize=True))


def _directed(weight: float | FloatArray, G: FloatArray) -> FloatArray:
    """Gradients (E, n, d, R) times a number or a tensor (d, d)."""
    return weight * G if np.ndim(weight) == 0 else np.asarray(
        np.einsum("ab,enbq->enaq", weight, G))


def expansion(at: Quadrature, weight: float | FloatArray) -> FloatArray:
    """Element matrices (E, n d, n) of thermal forces, the integral of weight d_a phi_i phi_j;
    weight: thermal stress per K, a number or a tensor (d, d)."""
    G = at.shape.gradients
    assert G is not None
    G = _directed(weight, G)
    E, n, d, _ = G.shape
    phi = at.shape.values * at.weights[:, None]
    phi = phi.sum(axis=2, keepdims=True) if G.shape[3] == 1 else phi  # constant gradients
    return np.asarray(G.reshape(E, n * d, -1) @ phi.transpose(0, 2, 1))


def hoop_stiffness(at: Quadrature, lam: Any, mu: Any) -> FloatArray:
    """Element matrices (E, n d, n d) of the stiffness of a body of revolution, with the hoop strain
    u_x / x: in the trace of the strain, and 2 mu times its square. at: quadrature of its section,
    weights with 2 pi x; phi: shape functions over x, those of the hoop strain."""
    G, phi, w = at.shape.gradients, at.shape.values / at.coordinates[0][:, None], at.weights
    assert G is not None
    E, n, d, _ = G.shape
    trace = np.broadcast_to(G, (E, n, d, w.shape[1])).copy()
    trace[:, :, 0] += phi
    flat = trace.reshape(E, n * d, -1)
    K = stiffness(at, 0.0, mu) + lam * (flat * w[:, None]) @ flat.transpose(0, 2, 1)
    K[:, ::d, ::d] += 2.0 * mu * (phi * w[:, None]) @ phi.transpose(0, 2, 1)
    return np.asarray(K)


def hoop_expansion(at: Quadrature, weight: Any) -> FloatArray:
    """Element matrices (E, n d, n) of the thermal forces of a body of revolution, with the hoop
    strain."""
    phi = np.broadcast_to(at.shape.values, (len(at.weights), *at.shape.values.shape[1:]))
    K, d = expansion(at, weight), at.coordinates.shape[0]
    K[:, ::d] += (phi * (weight * at.weights / at.coordinates[0])[:, None]) @ phi.transpose(0, 2, 1)
    return K


def _gradients(at: Quadrature) -> tuple[FloatArray, FloatArray]:
    """Gradients (E, n, d, R) and weights (E, R), R = 1 where they are constant in each cell."""
    G = at.shape.gradients
    assert G is not None
    return G, at.weights.sum(axis=1, keepdims=True) if G.shape[3] == 1 else at.weights


Form = Callable[..., FloatArray]
"""Element matrices (E, p, q) from a quadrature and weights."""


def matrix(
    form: Form, mesh: Mesh, order: int, *, rows: bool = False, columns: bool = False,
    cells: IntArray | None = None, **weights: float | FloatArray,
) -> Csr:
    """Matrix of a bilinear form on all cells, or on those with the given numbers; order: degree of
    the integrand with linear triangles, for which it is exact; so it is with others.

    form: element matrices from a quadrature and its `weights` (thickness times constants); rows,
    columns: the test or trial function is a vector: d N unknowns, number d * node + component,
    instead of N. Entries that cancel to round-off are dropped, so that a symmetric form has a
    symmetric pattern.
    """
    d, n = mesh.dimension, len(mesh.points)
    shape = (d * n if rows else n, d * n if columns else n)
    whole = csr_array(shape)
    for _, _, at, values in _chunks(form, mesh, order, cells, weights):
        i, j = (_unknowns(at.shape.nodes, d if vector else 1) for vector in (rows, columns))
        chunk = csr_array((values.ravel(), (
            np.broadcast_to(i[:, :, None], values.shape).ravel().astype(np.int32),
            np.broadcast_to(j[:, None, :], values.shape).ravel().astype(np.int32))), shape=shape)
        chunk.sum_duplicates()
        chunk.eliminate_zeros()
        whole = chunk if not whole.nnz else whole + chunk
    return _without_round_off(whole)


def elements(
    form: Form, mesh: Mesh, order: int, *, rows: bool = False, columns: bool = False,
    cells: IntArray | None = None, **weights: float | FloatArray,
) -> FloatArray:
    """(E, p, q) element matrices of a bilinear form (arguments as in `matrix`) on all cells, or on
    those with the given numbers; unknown number is d * node + component for vectors, with the nodes
    of a cell in the order of `mesh.nodes`, and zeros for repeated ones of mixed meshes."""
    d, nodes = mesh.dimension, mesh.nodes.shape[1]
    p, q = (nodes * d if vector else nodes for vector in (rows, columns))
    found = np.zeros((len(mesh.cells) if cells is None else len(cells), p, q))
    for here, space, _, values in _chunks(form, mesh, order, cells, weights):
        # to_ours: position in scikit-fem's order of each node in the order of the mesh
        i, j = (_unknowns(space.to_ours[None], d if vector else 1)[0] for vector in (rows, columns))
        found[here, : len(i), : len(j)] = values[:, i][:, :, j]
    return found


def facet_matrix(mesh: Mesh, facets: IntArray, weight: float) -> Csr:
    """(N, N) matrix of the form `mass` on facets (F, w) of corner numbers."""
    n = len(mesh.points)
    whole = csr_array((n, n))
    for _, at, _ in facet_quadratures(mesh, facets, 2):
        values, i = mass(at, weight), at.shape.nodes
        whole = whole + csr_array((values.ravel(), (
            np.broadcast_to(i[:, :, None], values.shape).ravel(),
            np.broadcast_to(i[:, None, :], values.shape).ravel())), shape=(n, n))
    whole.sum_duplicates()
    return whole


def facet_vector(mesh: Mesh, facets: IntArray, normal: bool = False) -> FloatArray:
    """(N,) integrals of the shape functions over facets (F, w) of corner numbers, or, (N, d), of
    those times the outward normal."""
    found = np.zeros((len(mesh.points), mesh.dimension if normal else 1))
    for _, at, n in facet_quadratures(mesh, facets, 1):
        factors = n if normal else np.ones((1, *at.weights.shape))
        values = np.einsum("eiq,deq->eid", np.broadcast_to(
            at.shape.values, (len(at.weights), *at.shape.values.shape[1:])), factors * at.weights)
        np.add.at(found, at.shape.nodes, values)
    return found if normal else found[:, 0]


def _unknowns(nodes: IntArray, d: int) -> IntArray:
    """(E, q d) numbers of the unknowns of cells with the nodes (E, q)."""
    return np.asarray((d * nodes[:, :, None] + np.arange(d)).reshape(len(nodes), -1))


def _chunks(
    form: Form, mesh: Mesh, order: int, cells: IntArray | None,
    weights: Mapping[str, float | FloatArray],
) -> Iterator[tuple[IntArray, Space, Quadrature, FloatArray]]:
    """Positions in `cells`, space, quadrature and element matrices, in scikit-fem's order of nodes,
    of some cells of one kind at a time, to limit memory. order: degree of the integrand with linear
    triangles; a body of revolution has the factor x in its weights, one degree more, and the forms
    of its hoop strain, with degree 2: their integrand phi_i phi_j / x is no polynomial."""
    hooped = form in (stiffness, expansion) and mesh.revolved
    made = form if not hooped else hoop_stiffness if form is stiffness else hoop_expansion
    order = 2 if hooped else order + mesh.revolved
    for here, nodes, space in spaces(mesh, cells):
        points, w = space.rule(order)
        some = max(CHUNK // (nodes.shape[1] * mesh.dimension)**2, 1)
        for start in range(0, len(here), some):
            own = slice(start, start + some)
            at = _turned(mesh, from_basis(space.basis(mesh, nodes[own], (points, w))))
            yield here[own], space, at, made(at, **weights)


def _without_round_off(A: Csr) -> Csr:
    """A (m, n) without entries |A_ij| <= ROUND_OFF sqrt(max_k |A_ik| max_k |A_kj|)."""
    size = abs(A)
    by_row, by_column = (np.sqrt(size.max(axis=axis).toarray()) for axis in (1, 0))
    size.data /= np.repeat(by_row, np.diff(A.indptr))
    size.data /= by_column[A.indices]
    A.data[size.data <= ROUND_OFF] = 0.0
    A.eliminate_zeros()
    return A
