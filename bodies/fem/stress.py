"""Strain and stress of a body from its stored displacements and temperatures.

    eps = sym grad u,    sigma = lam tr(eps) I + 2 mu eps - beta (T - T_free) I

in body axes. A body of revolution has the hoop strain u_x / x across its section. With nonlinear
strains eps is the Green-Lagrange strain, the same law gives the second Piola-Kirchhoff stress S,
and the Cauchy stress is F S F^T / det F with F = I + grad u. They are evaluated at the nodes of
each cell and averaged there over the cells, with their volumes as weights, separately for each
material: a node between two of them has a value of each, because the stress along their boundary
jumps.
"""

from functools import cached_property

import numpy as np

from sparsemor.core import FloatArray, IntArray, Mesh
from sparsemor.core.protocols.cells import by_kind, corners_of, padded

_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))


class CellStress:
    """Strain and stress of one body at its nodes, once for each material of their cells.

    points (N, d); cells (E, q): as `Mesh.nodes`; constants (R, 5, 6 or 46): lam, mu, beta, and lam,
    beta of the stress across the plane, of each material, and 1 of a body of revolution; or numbers
    of a general law (`Anisotropy.recovery`); region (E,): material of each cell; nonlinear: True
    for Green-Lagrange strains. nodes (P,): node of each value; own (E, q): number of the value at
    the nodes of each cell (`_by_material`).
    """

    def __init__(
        self, points: FloatArray, cells: IntArray, constants: FloatArray, region: IntArray,
        nonlinear: bool = False,
    ) -> None:
        self.points, self.cells, self.nonlinear = points, cells, nonlinear
        self.constants = constants[region]
        self.revolved, self.general = constants.shape[1] == 6, constants.shape[1] > 6
        self.nodes, self.own = _by_material(
            cells, np.unique(constants, axis=0, return_inverse=True)[1].ravel()[region])

    @cached_property
    def _slopes(self) -> tuple[FloatArray, FloatArray]:
        """(E, q, q, d) derivatives of the q shape functions of each cell (third axis) at each of
        its q nodes (second axis), 1/m; (E,) volumes, m^d. Cells of fewer nodes repeat their last
        one."""
        from sparsemor.bodies.fem import element_matrices

        E, q = self.cells.shape
        d, kinds = self.points.shape[1], by_kind(self.cells, self.points.shape[1])
        at = [here for here, _ in kinds]
        corners = [corners_of(d, own.shape[1]) for _, own in kinds]
        further = [own[:, p:] for (_, own), p in zip(kinds, corners, strict=True)]
        mesh = Mesh(self.points, padded([own[:, :p] for (_, own), p in zip(
            kinds, corners, strict=True)], at), midpoints=padded(further, at))
        slopes, volumes = np.zeros((E, q, q, d)), np.zeros(E)
        for here, nodes, space in element_matrices.spaces(mesh):
            points = np.array(space.element.doflocs).T
            basis = space.basis(mesh, nodes, (points, np.ones(points.shape[1])))
            grad = np.stack([np.asarray(b[0].grad) for b in basis.basis])  # (m, d, n, m)
            own = grad[space.to_ours][:, :, :, space.to_ours].transpose(2, 3, 0, 1)
            m = nodes.shape[1]
            slopes[here, :m, :m] = own
            slopes[here, m:] = slopes[here, m - 1 : m]  # of repeated nodes
            volumes[here] = basis.dx.mean(axis=1)
        return slopes, volumes

    def strain(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(P, 3, 3) strain for displacements u (N, d), m, and temperatures above the stress-free
        ones (N,), K; across the plane that of no stress in plane stress, else zero."""
        eps = self._strain(self._gradient(u))
        self._add_hoop(eps, u)
        eps[..., 2, 2] += self._across(eps, heating)
        return self._averaged(eps)

    def stress(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(P, 3, 3) Cauchy stress, Pa, for displacements u (N, d), m, and temperatures above the
        stress-free ones (N,), K."""
        return self._averaged(self.stress_in_cells(u, heating))

    def von_mises(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(P,) von Mises stress sqrt(3/2 s : s), Pa, s the deviator of the stress."""
        return _of_deviators(self.stress(u, heating), 1.5)

    def equivalent_strain(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(P,) equivalent strain sqrt(2/3 e : e), e the deviator of the strain."""
        return _of_deviators(self.strain(u, heating), 2.0 / 3.0)

    def stress_in_cells(self, u: FloatArray, heating: FloatArray) -> FloatArray:
        """(E, q, 3, 3) Cauchy stress, Pa, at the nodes of each cell, for displacements u (N, d), m,
        and temperatures above the stress-free ones (N,), K. constants (E, 5 or more): lam, mu,
        beta, and lam, beta across the plane, or numbers of a general law; nonlinear: Green-Lagrange
        strains, whose stress S becomes F S F^T / det F."""
        gradient, d = self._gradient(u), self.points.shape[1]
        eps = self._strain(gradient)
        self._add_hoop(eps, u)
        if self.general:
            return self._directional(eps, heating)
        lam, mu, beta, lam_out, beta_out = self.constants.T[:5, :, None]
        trace, dT = np.trace(eps, axis1=2, axis2=3), heating[self.cells]
        found = 2.0 * mu[..., None, None] * eps
        for i in range(3):
            inside = i < d
            found[..., i, i] += (lam if inside else lam_out) * trace
            found[..., i, i] -= (beta if inside else beta_out) * dT
        if self.nonlinear:
            F = np.zeros_like(eps)
            F[..., :d, :d] = gradient
            F[...] += np.eye(3)
            F[..., 2, 2] *= np.sqrt(np.maximum(1.0 + 2.0 * self._across(eps, heating), 0.0))
            found = F @ found @ F.swapaxes(2, 3) / np.linalg.det(F)[..., None, None]
        return np.asarray(found)

    def functional(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives (d N, 6) and (N, 6) of the weighted sum of the stress at nodes, weights (N,),
        by displacements and temperatures, for linear strains; components xx, yy, zz, xy, yz, xz. At
        a node of several materials it is that of the first of them. The stress at a node is the
        mean over its cells by their volumes; share (E, q): weight of the node times the cell's part
        in this mean. own == cells where a value belongs to the first material of its node."""
        slopes, volumes = self._slopes
        N, d = self.points.shape
        # nodes in cells of their first material, without repeated ones of mixed meshes
        first = (self.own == self.cells) & (np.diff(self.cells, axis=1, prepend=-1) != 0)
        share = np.where(first, volumes[:, None], 0.0)
        total = np.bincount(self.cells.ravel(), share.ravel(), N)
        share *= (weights / np.where(total > 0.0, total, 1.0))[self.cells]
        used = np.flatnonzero(share.any(axis=1))
        nodes, share = self.cells[used], share[used]
        lam, mu, beta, lam_out, beta_out = self.constants[used].T[:, :, None]
        # of each cell (E, q, d): weighted sum over its nodes of the gradients of shape functions
        D = np.einsum("ep,epaj->eaj", share, slopes[used])
        by_u, by_T = np.zeros((N, d, 6)), np.zeros((N, 6))
        for k, (i, j) in enumerate(((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))):
            part = np.zeros(D.shape)
            if max(i, j) < d:
                part[:, :, i] += mu * D[:, :, j]
                part[:, :, j] += mu * D[:, :, i]
            if i == j:
                part += (lam if i < d else lam_out)[:, :, None] * D
                np.add.at(by_T[:, k], nodes, -(beta if i < d else beta_out) * share)
            np.add.at(by_u[:, :, k], nodes, part)
        return by_u.reshape(-1, 6), by_T

    def _gradient(self, u: FloatArray) -> FloatArray:
        """(E, q, d, d) displacement gradient at the nodes of each cell."""
        return np.asarray(np.einsum("eai,epaj->epij", u[self.cells], self._slopes[0]))

    def _strain(self, gradient: FloatArray) -> FloatArray:
        """(E, q, 3, 3) strain at the nodes of each cell; across the plane zero."""
        d = gradient.shape[3]
        eps = np.zeros((*self.cells.shape, 3, 3))
        eps[..., :d, :d] = 0.5 * (gradient + gradient.swapaxes(2, 3))
        if self.nonlinear:
            eps[..., :d, :d] += 0.5 * gradient.swapaxes(2, 3) @ gradient
        return eps

    def _directional(self, eps: FloatArray, heating: FloatArray) -> FloatArray:
        """(E, q, 3, 3) stress of laws that depend on the direction (`Anisotropy.recovery`)."""
        i, j = np.array(_PAIRS).T
        strain = eps[..., i, j] * np.where(i == j, 1.0, 2.0)
        C, beta = self.constants[:, :36].reshape(-1, 6, 6), self.constants[:, 36:42]
        s = np.einsum("emn,eqn->eqm", C, strain) - beta[:, None] * heating[self.cells][..., None]
        found = np.zeros_like(eps)
        found[..., i, j] = s
        found[..., j, i] = s
        return found

    def _add_hoop(self, eps: FloatArray, u: FloatArray) -> None:
        """Adds the hoop strain u_x / x of a body of revolution; on the axis that is eps_xx."""
        if self.revolved:
            x = self.points[self.cells][..., 0]
            off = x > 1e-12 * float(np.ptp(self.points, axis=0).max())
            eps[..., 2, 2] = np.where(
                off, u[self.cells][..., 0] / np.where(off, x, 1.0), eps[..., 0, 0])

    def _across(self, eps: FloatArray, heating: FloatArray) -> FloatArray:
        """(E, q) strain across the plane that makes no stress there, of plane stress; else zero.
        eps (E, q, 3, 3): strains; heating (N,): temperatures above the stress-free ones, K.
        constants: of a general law the last four, factors of xx, yy, 2 xy and the temperature; else
        lam, mu, beta, with lam and beta across the plane, which are 0 in plane stress."""
        if self.points.shape[1] == 3 or self.revolved:
            return np.zeros(self.cells.shape)
        if self.general:
            a = self.constants[:, None, 42:]
            return np.asarray(
                a[..., 0] * eps[..., 0, 0] + a[..., 1] * eps[..., 1, 1]
                + 2.0 * a[..., 2] * eps[..., 0, 1] + a[..., 3] * heating[self.cells])
        lam, mu, beta, lam_out, beta_out = self.constants.T[:5, :, None]
        across = (beta * heating[self.cells] - lam * (eps[..., 0, 0] + eps[..., 1, 1])) / (2.0 * mu)
        return np.where((lam_out == 0.0) & (beta_out == 0.0), across, 0.0)

    def _averaged(self, values: FloatArray) -> FloatArray:
        """(P, 3, 3) mean of values (E, q, 3, 3) at nodes over the cells of one material."""
        n, at = len(self.nodes), self.own.ravel()
        weights = np.repeat(self._slopes[1], self.cells.shape[1])
        weights[1:][(np.diff(self.cells, axis=1, prepend=-1) == 0).ravel()[1:]] = 0.0  # repeated
        total = np.bincount(at, weights, n)
        flat = values.reshape(-1, 9)
        sums = np.stack([np.bincount(at, weights * column, n) for column in flat.T], axis=1)
        return np.asarray((sums / np.where(total > 0.0, total, 1.0)[:, None]).reshape(n, 3, 3))


def _by_material(cells: IntArray, region: IntArray) -> tuple[IntArray, IntArray]:
    """Nodes (P,) of the values of a field with a value for each node and material of its cells, and
    the numbers of these values in cells (E, q). The first N values belong to the nodes 0 to N - 1,
    in their material of lowest number; then follow those in further materials."""
    materials = int(region.max(initial=0)) + 1
    pairs, of = np.unique(cells * materials + region[:, None], return_inverse=True)
    node = pairs // materials
    count = int(cells.max(initial=-1)) + 1
    further = np.diff(node, prepend=-1) == 0
    number = np.where(further, count - 1 + np.cumsum(further), node)
    return np.concatenate([np.arange(count), node[further]]), number[of].reshape(cells.shape)


def _of_deviators(tensors: FloatArray, factor: float) -> FloatArray:
    """(N,) sqrt(factor s : s) of the deviators s of tensors (N, 3, 3)."""
    s = tensors - np.trace(tensors, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3.0
    return np.asarray(np.sqrt(factor * np.einsum("nij,nij->n", s, s)))
