"""Bending stiffness of a mesh of linear elements, compared with quadratic ones on the same mesh.

Linear elements cannot bend without shear, so a mesh with few of them over the height is too stiff.
The loads are those of the body's lowest modes phi, f = rho phi (with a reference condition that
only prevents rigid motion, without their resultant, so that the condition does not act). With the
stiffness K_1 of the linear and K_2 of the quadratic elements,

    share = 1 - (f . u_1) / (f . u_2),    K_1 u_1 = P^T f,    K_2 u_2 = f,

P: interpolation of linear displacements. u_2 is found by conjugate gradients from P u_1,
preconditioned by P K_1^-1 P^T and the diagonal of the midpoints: f . u grows in every step, so a
truncated iteration underestimates the share. K_2 is never assembled.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import splu

from sparsemor.bodies.fem.elasticity import rigid_modes
from sparsemor.bodies.fem.field_matrices import Elasticity
from sparsemor.bodies.fem.integrals import on_cells
from sparsemor.bodies.fem.quadratic_cells import with_midpoints
from sparsemor.core import FloatArray, Mesh, Note, information
from sparsemor.core.protocols.cells import KINDS, by_kind

LARGEST = {2: 60_000, 3: 20_000}
"""Number of free displacements, by dimension, above which the comparison is left out: it would take
longer than a few seconds."""
NOTED, WARNED = 0.05, 0.1
"""Shares of the displacement above which there is information, and a warning."""
MODES, STEPS, ENOUGH = 3, 20, 0.02
"""Number of modes; largest number of steps, and relative growth of the excess in a step at which
the iteration ends."""


def excess_stiffness(mesh: Mesh, e: Elasticity, thickness: float) -> float:
    """Largest share, over the lowest modes, of the displacement that linear elements lose; 0.0 for
    quadratic elements and for bodies with more than `LARGEST` displacements."""
    if mesh.order == 2 or len(e.free) > LARGEST[mesh.dimension] or not len(e.free):
        return 0.0
    try:
        return _Comparison(mesh, e, thickness).share()
    except (RuntimeError, np.linalg.LinAlgError):  # a singular matrix is reported by the run itself
        return 0.0


def bending_notes(
    body: str, mesh: Mesh, e: Elasticity, thickness: float
) -> Iterator[Note]:
    """Note on a mesh of linear elements that is too stiff in bending: information above `NOTED`, a
    warning above `WARNED`. share: largest share, over the lowest modes, of the displacement under
    their loads that is lost against quadratic elements; thickness: m, 1 in space."""
    share = excess_stiffness(mesh, e, thickness)
    if share > NOTED:
        less = (f"loads that bend it into its lowest modes displace it {100 * share:.2g} % less "
                "than with quadratic elements on the same mesh")
        yield Note(f"the linear elements of {body} are too stiff: {less}; set bodies.{body}.order: "
                   "2, or where that is not possible take more elements over the height",
                   "stiff_in_bending") if share > WARNED else information(
            f"body {body} has linear elements: {less} (bodies.{body}.order: 2)",
            "stiff_in_bending")


class _Comparison:
    """Linear and quadratic elements of one mesh. u (n, j): j fields of nodal displacements, unknown
    number d node + component."""

    def __init__(self, mesh: Mesh, e: Elasticity, thickness: float) -> None:
        """fine: the mesh with midpoints, of n nodes of which the first `corners` are those of the
        linear elements; shapes, laws: quadrature of the cells of each kind, and lam, mu times the
        thickness in each cell; P (n, corners): `_interpolation`; held (corners, d): True for
        displacements of the reference condition, free (d n,): for those that it leaves; rigid:
        rigid-body modes if the condition is statically determinate, else none."""
        self.d, self.e = mesh.dimension, e
        self.fine = with_midpoints(Mesh(mesh.points, mesh.cells))
        self.corners, self.n = len(mesh.points), len(self.fine.points)
        self.shapes = on_cells(self.fine, 0)
        self.P = csr_array(_interpolation(self.fine, self.corners, self.n))
        lam, mu = np.zeros((2, len(mesh.cells)))
        for cells, law in e.regions:
            here: Any = slice(None) if cells is None else cells
            lam[here], mu[here] = thickness * law.lam, thickness * law.mu
        self.laws = [(lam[here], mu[here]) for here, _ in self.shapes]
        self.held = np.ones((self.corners, self.d), np.bool_)
        self.held.reshape(-1)[e.free] = False
        self.free = (self.P @ ~self.held > 0.0).ravel()  # depends on some free corner
        self.solver: Any = splu(e.stiffness[e.free][:, e.free].tocsc())
        rigid = rigid_modes(mesh.points)
        determinate = np.count_nonzero(self.held) == rigid.shape[1]
        self.rigid = rigid if determinate else rigid[:, :0]

    def share(self) -> float:
        """Largest share of the work f.u of test loads that linear elements miss, 1 - f.u_1 / f.u_2:
        u_2 of K_2 u_2 = f by conjugate gradients from the linear solution u_1 on, all loads side by
        side, preconditioned by linear elements and the midpoints' diagonal. coarse: K_1^-1 P^T,
        prolonged: P, stiffness: K_2 times fields (d n, j); free (d n,): False in rows that the
        reference condition fixes; r: residual, p: search directions, work: f.u, which grows."""
        f = self.loads()
        f[~self.free] = 0.0
        u = self.prolonged(self.coarse(f))
        first = np.sum(f * u, axis=0)
        work, r = first.copy(), f - self.stiffness(u)
        r[~self.free] = 0.0
        diagonal = self.midpoint_diagonal()
        p, rz_before = np.zeros_like(f), np.ones(f.shape[1])
        for step in range(STEPS):
            preconditioned = self.prolonged(self.coarse(r)) + diagonal * r
            rz = np.sum(r * preconditioned, axis=0)
            p = preconditioned + (rz / rz_before if step else 0.0 * rz) * p
            Ap = self.stiffness(p)
            Ap[~self.free] = 0.0
            size = np.sum(p * Ap, axis=0)
            length = np.divide(rz, size, out=np.zeros_like(rz), where=size > 0.0)
            r -= length * Ap
            # a step along p adds length^2 p.K_2 p = length (r.z) to the work
            work, rz_before = work + length * rz, np.where(rz > 0.0, rz, 1.0)
            if (length * rz <= ENOUGH * (work - first)).all():
                break
        return float((1.0 - first / work).max())

    # ------------------------------------------------------------------ loads

    def loads(self) -> FloatArray:
        """(d n, j) loads rho phi of the lowest modes phi on the nodes of the quadratic elements: of
        subspace iteration V <- K_1^-1 M V with the linear ones, from quadratic polynomials in the
        coordinates. load: M times linear fields on all n nodes, coarse: K_1^-1 P^T of it."""
        X = self.fine.points - self.fine.points.mean(axis=0)
        X = X / np.abs(X).max()
        i, j = np.triu_indices(self.d)
        powers = np.hstack([np.ones((self.n, 1)), X, X[:, i] * X[:, j]])[: self.corners]
        V = np.einsum("nm,ab->namb", powers, np.eye(self.d)).reshape(self.corners * self.d, -1)
        for _ in range(3):
            V = self.coarse(self.load(V))
            V = np.linalg.qr(V)[0]
            # Rayleigh-Ritz: the lowest modes of K phi = w^2 M phi have the largest 1 / w^2
            K, M = V.T @ (self.e.stiffness @ V), V.T @ self.restricted(self.load(V))
            V = V @ eigh(M, K)[1][:, ::-1][:, : 2 * MODES]
        return self.load(V[:, :MODES])

    def load(self, V: FloatArray) -> FloatArray:
        """(n, j) load rho phi of linear fields V at the corners, without its resultant where the
        reference condition is to have no reaction."""
        f = self._inertia(V)
        if self.rigid.shape[1]:
            of_rigid = self._inertia(self.rigid)
            R = self.prolonged(self.rigid)
            f -= of_rigid @ np.linalg.solve(R.T @ of_rigid, R.T @ f)
        return f

    def _inertia(self, V: FloatArray) -> FloatArray:
        """(d n, j) inertia loads of linear fields V (d corners, j) of unit density, six at a
        time."""
        return np.hstack([self._inertia_of(V[:, k : k + 6]) for k in range(0, V.shape[1], 6)])

    def _inertia_of(self, V: FloatArray) -> FloatArray:
        """Integrals of the shape functions of all nodes times the fields V."""
        u = self.prolonged(V).reshape(self.n, -1)
        return self._gathered([
            at.shape.values @ (at.weights[:, :, None] * (at.shape.values.swapaxes(1, 2)
                                                         @ u[at.shape.nodes]))
            for _, at in self.shapes], V.shape[1])

    # ------------------------------------------------------------------ operators

    def prolonged(self, V: FloatArray) -> FloatArray:
        """(d n, j) linear fields (d corners, j) at all nodes."""
        return np.asarray(self.P @ V.reshape(self.corners, -1)).reshape(self.d * self.n, -1)

    def restricted(self, f: FloatArray) -> FloatArray:
        """(d corners, j) loads (d n, j) on linear fields: the transpose of `prolonged`."""
        return np.asarray(self.P.T @ f.reshape(self.n, -1)).reshape(self.d * self.corners, -1)

    def coarse(self, f: FloatArray) -> FloatArray:
        """(d corners, j) displacements K_1^-1 P^T f of the linear elements."""
        found = np.zeros((self.d * self.corners, f.shape[1]))
        found[self.e.free] = self.solver.solve(self.restricted(f)[self.e.free])
        return found

    def stiffness(self, u: FloatArray) -> FloatArray:
        """(d n, j) forces K_2 u, N, of fields u (d n, j), m: integrals of grad phi . stress, with
        the stress lam tr(grad u) I + mu (grad u + grad u^T) at the quadrature points. shapes, laws:
        of the cells of each kind their quadrature, and lam, mu times the thickness in each cell."""
        j, found = u.shape[1], []
        for (_, at), (lam, mu) in zip(self.shapes, self.laws, strict=True):
            G = at.shape.gradients
            assert G is not None
            grad = np.einsum("eiaj,eibq->eqabj", u.reshape(self.n, self.d, j)[at.shape.nodes], G,
                             optimize=True)
            stress = mu[:, None, None, None, None] * (grad + grad.swapaxes(2, 3))
            trace = lam[:, None, None] * np.einsum("eqaaj->eqj", grad)
            for a in range(self.d):
                stress[:, :, a, a] += trace
            stress *= at.weights[:, :, None, None, None]
            found.append(np.einsum("eqabj,eibq->eiaj", stress, G, optimize=True))
        return self._gathered(found, j)

    def midpoint_diagonal(self) -> FloatArray:
        """(d n, 1) inverse diagonal of K_2 at the free midpoints, zero at the corners, which come
        first, and in fixed rows: by an entry infinity before the inversion. K_2 has the diagonal
        integral of (lam + mu) (d_a phi)^2 + mu |grad phi|^2. shapes, laws: as in `stiffness`."""
        found = []
        for (_, at), (lam, mu) in zip(self.shapes, self.laws, strict=True):
            assert at.shape.gradients is not None
            square = np.einsum("eq,eiaq->eia", at.weights, at.shape.gradients**2)
            found.append((lam + mu)[:, None, None] * square + (
                mu[:, None] * square.sum(axis=2))[:, :, None])
        total = self._gathered(found, 1)
        total[: self.d * self.corners] = np.inf
        total[~self.free] = np.inf
        return np.asarray(1.0 / total)

    def _gathered(self, parts: Sequence[FloatArray], count: int) -> FloatArray:
        """(d n, j) sums over the cells of values (E, q, ...) of each kind at their nodes."""
        found = np.zeros((self.n, self.d * count))
        for (_, at), values in zip(self.shapes, parts, strict=True):
            flat, nodes = values.reshape(at.shape.nodes.size, -1), at.shape.nodes.ravel()
            for column, own in enumerate(flat.T):
                found[:, column] += np.bincount(nodes, own, self.n)
        return found.reshape(self.d * self.n, count)


def _interpolation(fine: Mesh, corners: int, n: int) -> Any:
    """(n, corners) values of linear fields at all n nodes of a mesh of second order, whose first
    points are the corners: the means of the corners between which a further node lies."""
    rows, columns = [np.arange(corners)], [np.arange(corners)]
    for here, own in by_kind(fine.cells, fine.dimension):
        for i, between in enumerate(KINDS[fine.dimension, own.shape[1]].further):
            middle, first = np.unique(fine.midpoints[here, i], return_index=True)
            rows.append(np.repeat(middle, len(between)))
            columns.append(own[first][:, list(between)].ravel())
    found = csr_array((np.ones(sum(map(len, rows))), (
        np.concatenate(rows), np.concatenate(columns))), shape=(n, corners))
    found.data[:] = 1.0
    return diags_array(1.0 / found.sum(axis=1)) @ found
