"""Bending stiffness of a mesh of linear elements, compared with quadratic ones on the same mesh.

Linear triangles and tetrahedra cannot bend without shear, so a mesh with few of them over the
height is too stiff. The loads are those of the body's lowest modes phi, f = rho phi (with a
reference condition that only prevents rigid motion, without their resultant, so that the condition
does not act). With the stiffness K_1 of the linear and K_2 of the quadratic elements,

    share = 1 - (f . u_1) / (f . u_2),    K_1 u_1 = P^T f,    K_2 u_2 = f,

P: interpolation of linear displacements. u_2 is found by conjugate gradients from P u_1,
preconditioned by P K_1^-1 P^T and the diagonal of the midpoints: f . u grows in every step, so a
truncated iteration underestimates the share. K_2 is never assembled.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh
from scipy.sparse.linalg import splu

from sparsemor.bodies.fem.fields import Elasticity
from sparsemor.bodies.fem.quadratic import with_midpoints
from sparsemor.bodies.mesh.simplices import EDGES, gradients, signed_measures
from sparsemor.bodies.reference import rigid_modes
from sparsemor.core import FloatArray, IntArray, Mesh, Note, information

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
    warning above `WARNED`."""
    share = excess_stiffness(mesh, e, thickness)
    if share > NOTED:
        less = (f"loads that bend it into its lowest modes displace it {100 * share:.2g} % less "
                "than with quadratic elements on the same mesh")
        yield Note(f"the linear elements of {body} are too stiff: {less}; set bodies.{body}.order: "
                   "2, or where that is not possible take more elements over the height",
                   "stiff_in_bending") if share > WARNED else information(
            f"body {body} has linear elements: {less} (bodies.{body}.order: 2)",
            "stiff_in_bending")


@dataclass(slots=True, eq=False)
class _Shapes:
    """Quadratic shape functions at d + 1 points of each cell, exact for degree 2.

    values (p, q): of q nodes at p points; slopes (E, p, q, d), 1/m; weights (E,): volume of a
    point, m^d.
    """

    nodes: IntArray
    values: FloatArray
    slopes: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, mesh: Mesh) -> "_Shapes":
        d = mesh.dimension
        grad = gradients(mesh)
        b = (d + 2 - np.sqrt(d + 2.0)) / ((d + 1) * (d + 2))
        at = b + (1.0 - (d + 1) * b) * np.eye(d + 1)
        i, j = EDGES[:, : mesh.midpoints.shape[1]]
        values = np.hstack([at * (2.0 * at - 1.0), 4.0 * at[:, i] * at[:, j]])
        slopes = np.concatenate([
            (4.0 * at - 1.0)[None, :, :, None] * grad[:, None],
            4.0 * (at[None, :, i, None] * grad[:, None, j]
                   + at[None, :, j, None] * grad[:, None, i])], axis=2)
        weights = np.abs(signed_measures(mesh.points, mesh.cells)) / (d + 1)
        return cls(mesh.nodes, values, slopes, weights)


class _Comparison:
    """Linear and quadratic elements of one mesh. u (n, j): j fields of nodal displacements, unknown
    number d node + component."""

    def __init__(self, mesh: Mesh, e: Elasticity, thickness: float) -> None:
        self.d, self.e = mesh.dimension, e
        self.fine = with_midpoints(Mesh(mesh.points, mesh.cells))
        self.corners, self.n = len(mesh.points), len(self.fine.points)
        self.shapes = _Shapes.of(self.fine)
        self.ends = np.zeros((self.n - self.corners, 2), np.int64)
        i, j = EDGES[:, : self.fine.midpoints.shape[1]]
        self.ends[self.fine.midpoints - self.corners] = np.stack(
            [mesh.cells[:, i], mesh.cells[:, j]], axis=2)
        self.lam, self.mu = np.zeros((2, len(mesh.cells)))
        for cells, law in e.regions:
            here: Any = slice(None) if cells is None else cells
            self.lam[here], self.mu[here] = thickness * law.lam, thickness * law.mu
        self.held = np.ones((self.corners, self.d), np.bool_)
        self.held.reshape(-1)[e.free] = False
        self.free = ~np.concatenate([self.held, self.held[self.ends].all(axis=1)]).ravel()
        self.solver: Any = splu(e.stiffness[e.free][:, e.free].tocsc())
        rigid = rigid_modes(mesh.points)
        determinate = np.count_nonzero(self.held) == rigid.shape[1]
        self.rigid = rigid if determinate else rigid[:, :0]

    def share(self) -> float:
        f = self.loads()
        f[~self.free] = 0.0
        u = self.prolonged(self.coarse(f))
        first = np.sum(f * u, axis=0)
        work, r = first.copy(), f - self.stiffness(u)
        r[~self.free] = 0.0
        diagonal = self.midpoint_diagonal()
        p, before = np.zeros_like(f), np.ones(f.shape[1])
        for step in range(STEPS):
            z = self.prolonged(self.coarse(r)) + diagonal * r
            now = np.sum(r * z, axis=0)
            p = z + (now / before if step else 0.0 * now) * p
            Ap = self.stiffness(p)
            Ap[~self.free] = 0.0
            size = np.sum(p * Ap, axis=0)
            length = np.divide(now, size, out=np.zeros_like(now), where=size > 0.0)
            r -= length * Ap
            work, before = work + length * now, np.where(now > 0.0, now, 1.0)
            if (length * now <= ENOUGH * (work - first)).all():
                break
        return float((1.0 - first / work).max())

    # ------------------------------------------------------------------ loads

    def loads(self) -> FloatArray:
        """(n, j) loads of the lowest modes on the nodes of the quadratic elements: of subspace
        iteration with the linear ones, from quadratic polynomials."""
        X = self.fine.points - self.fine.points.mean(axis=0)
        X = X / np.abs(X).max()
        i, j = np.triu_indices(self.d)
        powers = np.hstack([np.ones((self.n, 1)), X, X[:, i] * X[:, j]])[: self.corners]
        V = np.einsum("nm,ab->namb", powers, np.eye(self.d)).reshape(self.corners * self.d, -1)
        for _ in range(3):
            V = self.coarse(self.load(V))
            V = np.linalg.qr(V)[0]
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
        return np.hstack([self._inertia_of(V[:, k : k + 6]) for k in range(0, V.shape[1], 6)])

    def _inertia_of(self, V: FloatArray) -> FloatArray:
        s, u = self.shapes, self.prolonged(V)
        at = np.einsum("pq,eqm->epm", s.values, u.reshape(self.n, -1)[s.nodes])
        return self._gathered(np.einsum("e,pq,epm->eqm", s.weights, s.values, at), V.shape[1])

    # ------------------------------------------------------------------ operators

    def prolonged(self, V: FloatArray) -> FloatArray:
        """(d n, j) linear fields (d corners, j) at all nodes."""
        at = V.reshape(self.corners, self.d, -1)
        return np.concatenate([at, at[self.ends].mean(axis=1)]).reshape(self.d * self.n, -1)

    def restricted(self, f: FloatArray) -> FloatArray:
        """(d corners, j) loads (d n, j) on linear fields: the transpose of `prolonged`."""
        whole = f.reshape(self.n, self.d, -1)
        found = whole[: self.corners].copy()
        for end in self.ends.T:
            np.add.at(found, end, 0.5 * whole[self.corners:])
        return found.reshape(self.d * self.corners, -1)

    def coarse(self, f: FloatArray) -> FloatArray:
        """(d corners, j) displacements K_1^-1 P^T f of the linear elements."""
        found = np.zeros((self.d * self.corners, f.shape[1]))
        found[self.e.free] = self.solver.solve(self.restricted(f)[self.e.free])
        return found

    def stiffness(self, u: FloatArray) -> FloatArray:
        """(d n, j) forces K_2 u, N."""
        s, j = self.shapes, u.shape[1]
        at = u.reshape(self.n, self.d, j)[s.nodes]
        grad = np.einsum("eqaj,epqb->epabj", at, s.slopes, optimize=True)
        stress = self.mu[:, None, None, None, None] * (grad + grad.swapaxes(2, 3))
        trace = self.lam[:, None, None] * np.einsum("epaaj->epj", grad)
        for a in range(self.d):
            stress[:, :, a, a] += trace
        stress *= s.weights[:, None, None, None, None]
        return self._gathered(np.einsum("epabj,epqb->eqaj", stress, s.slopes, optimize=True), j)

    def midpoint_diagonal(self) -> FloatArray:
        """(d n, 1) inverse diagonal of K_2 at the free midpoints, zero at the corners."""
        s = self.shapes
        square = np.einsum("e,epqa->eqa", s.weights, s.slopes**2)
        own = (self.lam + self.mu)[:, None, None] * square + (
            self.mu[:, None] * square.sum(axis=2))[:, :, None]
        total = self._gathered(own, 1)
        total[: self.d * self.corners] = np.inf
        total[~self.free] = np.inf
        return np.asarray(1.0 / total)

    def _gathered(self, values: FloatArray, count: int) -> FloatArray:
        """(d n, j) sums over the cells of values (E, q, ...) at their nodes."""
        flat = values.reshape(self.shapes.nodes.size, -1)
        at = self.shapes.nodes.ravel()
        found: FloatArray = np.stack(
            [np.bincount(at, column, self.n) for column in flat.T], axis=1, dtype=np.float64)
        return found.reshape(self.d * self.n, count)
