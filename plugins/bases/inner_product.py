"""Inner products (x, y) = x^T X y of the fields of one block, with X symmetric positive definite.

`mass`: X = M, the L2 product weighted by density (for temperatures the capacity C). `stiffness`:
X = K, the energy product (for temperatures the conductivity K_T, the H1 seminorm). The stiffness of
a body that can move rigidly, and the conductivity of an insulated one, are only semi-definite: X =
K + lambda M then, where lambda is the lowest eigenvalue above zero of K x = lambda M x. The kernel
is measured in the mass at the frequency lambda; for the part x of a field that is M-orthogonal to
the kernel, x^T K x <= x^T X x <= 2 x^T K x, since lambda x^T M x <= x^T K x.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import solve_triangular
from scipy.sparse import csr_array

from sparsemor.core import BlockData, Csr, FloatArray, InputError, svd
from sparsemor.plugins.bases.eigenmodes import lowest_modes
from sparsemor.plugins.bases.static_response import is_thermal

Product = Literal["none", "mass", "stiffness"]

NULL = 1e-12
"""Energy x^T K x of a rigid motion x, relative to x^T |K| x, below which it is round-off: in double
precision about 1e-16 for a free body, and at least the share of clamped elements otherwise."""


@dataclass(frozen=True, slots=True, eq=False)
class InnerProduct:
    """Inner product (x, y) = x^T X y of n unknowns; X None: the Euclidean one.

    what: description of X in messages. A Cholesky factor of X is not needed: only the small Gram
    matrices of its columns are factorized.
    """

    X: Csr | None = None
    what: str = ""

    @property
    def euclidean(self) -> bool:
        return self.X is None

    def times(self, Y: FloatArray) -> FloatArray:
        """Product X Y (n, l) with columns Y (n, l)."""
        return Y if self.X is None else np.asarray(self.X @ Y)

    def norms(self, Y: FloatArray) -> FloatArray:
        """Norms (l,) of the columns of Y (n, l)."""
        if self.X is None:
            return np.asarray(np.linalg.norm(Y, axis=0))
        return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->j", Y, self.times(Y)), 0.0)))

    def norm(self, Y: FloatArray) -> float:
        """Root of the summed squared norms of the columns of Y (n, l)."""
        return float(np.linalg.norm(Y if self.X is None else self.norms(Y)))

    def amplified(self, U: FloatArray, s: FloatArray) -> float:
        """Norm of round-off of relative size 1 in fields with the singular vectors U (n, l) and
        values s (l,): it has no preferred direction, so its norm is that of the fields in the
        2-norm times the root mean square of the eigenvalues' roots, (trace X / n)^(1/2)."""
        if self.X is None:
            return float(s[0])
        return float(np.linalg.norm(U * s, 2) * np.sqrt(self.X.diagonal().mean()))

    def singular(self, U: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Left singular vectors Y (n, l), Y^T X Y = I, and singular values (l,), decreasing, in
        this product of a matrix with Euclidean ones U (n, l), s (l,).

        With U = Q R, Q^T X Q = I, those of R diag(s) follow by a small SVD: for a Cholesky factor L
        L^T = X they are L^-T times the left singular vectors of L^T A.
        """
        if self.X is None:
            return U, s
        Q, R = self.qr(U)
        W, values, _ = svd(R * s)
        return Q @ W, values

    def qr(self, Y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Q (n, l) and R (l, l) of Y = Q R with Q^T X Q = I and R upper triangular.

        Householder QR, then Cholesky factorizations of Q^T X Q until its columns are orthonormal to
        round-off (CholeskyQR2; Yamamoto et al. 2015, Electron. Trans. Numer. Anal. 44). Raises
        InputError where X is not positive definite on the span of Y.
        """
        Q, R = np.linalg.qr(Y)
        if self.X is None:
            return Q, R
        for _ in range(2):
            G = Q.T @ self.times(Q)
            try:
                L = np.linalg.cholesky(0.5 * (G + G.T))
            except np.linalg.LinAlgError:
                raise InputError(f"{self.what} is not positive definite, so it is no inner "
                                 "product: take product: none", "product") from None
            Q, R = np.ascontiguousarray(solve_triangular(L, Q.T, lower=True).T), L.T @ R
        return Q, R


def inner_product(data: BlockData, product: Product) -> InnerProduct:
    """Inner product of a block's fields. Raises InputError for a semi-definite stiffness whose
    kernel is more than the rigid motions (uniform temperature)."""
    if product == "none":
        return InnerProduct()
    if product == "mass":
        return InnerProduct(data.mass, f"the mass of {data.name}")
    K, what = data.stiffness, f"the stiffness of {data.name}"
    free = free_rigid_motions(data)
    if not free:
        return InnerProduct(K, what)
    shift = float(lowest_modes(data, free + 1).values[-1]) if free < data.size else 0.0
    if shift <= 0.0:
        raise InputError(f"{what} has more motions without energy than the {free} of a rigid body: "
                         "take product: mass", "product")
    return InnerProduct(csr_array(K + shift * data.mass), what)


def free_rigid_motions(data: BlockData) -> int:
    """Number of independent rigid motions x (uniform temperatures) with K x = 0."""
    N = np.linalg.qr(rigid_motions(data))[0]
    energy = N.T @ (data.stiffness @ N)
    terms = float(np.einsum("ij,ij->j", np.abs(N), abs(data.stiffness) @ np.abs(N)).max())
    values = np.linalg.eigvalsh(0.5 * (energy + energy.T))
    return int((np.abs(values) <= NULL * terms).sum())


def rigid_motions(data: BlockData) -> FloatArray:
    """Infinitesimal rigid motions (n, r) of displacements, about the centre of the nodes: r = 1, 3
    or 6 in 1, 2 or 3 dimensions. For other fields the uniform one (n, 1)."""
    n, d = data.coordinates.shape
    if is_thermal(data) or not data.component.any():
        return np.ones((n, 1))
    X = data.coordinates - data.coordinates.mean(axis=0)
    X = X / max(float(np.abs(X).max()), 1e-300)
    columns = list[FloatArray]()
    for i in range(d):
        columns.append((data.component == i).astype(np.float64))
        for j in range(i):  # rotation in the plane of axes i and j
            turn = np.zeros(n)
            turn[data.component == i] = X[data.component == i, j]
            turn[data.component == j] = -X[data.component == j, i]
            columns.append(turn)
    U, s, _ = np.linalg.svd(np.stack(columns, axis=1), full_matrices=False)
    return np.asarray(U[:, s > 1e-10 * s[0]])
