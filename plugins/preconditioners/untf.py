"""Unit-norm tight frame preconditioner (Liang et al. 2026, Sec. 3.2, Eq. 29-31)."""

import numpy as np
from pydantic import Field
from scipy import linalg

from sparsemor.core import FloatArray, InputError, Preconditioner
from sparsemor.core.linalg.dense import condition_number, unit_columns


class UnitNormTightFrame(Preconditioner):
    """Unit-norm tight frame: P that makes P B nearly such a frame, of low mutual coherence.

    B (m, k) are the sampled rows of the linear equations for k coefficients. P is nonsingular, so P
    B c = P b has the solutions of B c = b; only the order in which a greedy solver picks atoms
    (columns) and the weights of its least squares change. Alternating projections after
    Tsiligianni, Kondi and Katsaggelos, IEEE Trans. Inf. Theory 60 (2014) 2319.
    """

    iterations: int = Field(default=20, ge=1, le=1000)
    """Largest number of alternating projections."""
    tolerance: float = Field(default=0.0, ge=0.0)
    """Stop early when no cosine between two columns changes by more than this. 0: never."""
    products: int | None = Field(default=None, ge=1, le=100)
    """Number of products with the Gram matrix that approximate its leading eigenvectors, from those
    of the projection before. Left out: exact eigenvectors, as published. One product costs an
    eighth of them, and P B is closer to a tight frame, because it stays near the row space of B."""

    def check(self, rows: int, atoms: int) -> str:
        if atoms >= rows:
            return ""
        return (
            f"UNTF needs at least as many atoms as rows: {atoms} atoms < {rows} rows; take at "
            f"least {rows} atoms, at most {atoms} rows, or preconditioner: none"
        )

    def build(self, A: FloatArray) -> FloatArray:
        """Preconditioner P (m, m) for the sampled rows A (m, k), k >= m, B of the class. Raises
        InputError when k < m or A lacks row rank."""
        m, k = A.shape
        reason = self.check(m, k)
        if reason:
            raise InputError(reason)
        if condition_number(A) == float("inf"):
            raise InputError(
                f"UNTF needs {m} independent rows, but the sampled rows of the {k} atoms have "
                f"rank {np.linalg.matrix_rank(A)}: take fewer rows, more atoms, or another sampler"
            )
        inverse = _right_inverse(A)
        P = np.eye(m)
        cosines = np.zeros((k, k))
        for _ in range(self.iterations):
            F = unit_columns(P @ A)
            G = F.T @ F
            if np.abs(G - cosines).max() <= self.tolerance:
                break
            cosines = G
            # Eq. 31 as a least-squares fit of S by P B: S B^+ of the first B, whatever P was
            P = self._tight_frame(_shrunk(G, m), F) @ inverse
        if condition_number(P) == float("inf"):
            raise InputError(
                f"UNTF found a tight frame that the {m} sampled rows cannot reach (P is "
                "singular): take fewer rows, more atoms, or preconditioner: none"
            )
        return P

    def _tight_frame(self, G: FloatArray, F: FloatArray) -> FloatArray:
        """Tight frame S (m, k) nearest to a rank-m square root of the Gram matrix G (Eq. 30); F (m,
        k): frame before.

        With G = U Lambda U^T cut at rank m and S = Lambda^(1/2) U^T, the step sqrt(k/m) (S
        S^T)^(-1/2) S is sqrt(k/m) U^T: no root of a small or negative eigenvalue is taken, and any
        other orthonormal basis of the columns of U gives the same Gram matrix.
        """
        m, k = F.shape
        if self.products is None:
            U = linalg.eigh(G, subset_by_index=(k - m, k - 1), check_finite=False)[1][:, ::-1]
        else:
            U = F.T
            for _ in range(self.products):
                U = np.linalg.qr(G @ U)[0]
        return np.asarray(np.sqrt(k / m) * U.T)


def _right_inverse(A: FloatArray) -> FloatArray:
    """Right inverse B^T (B B^T)^-1 (k, m) of B = A, by QR of B^T: B B^T would square the condition
    number."""
    Q, R = np.linalg.qr(A.T)
    return np.asarray(linalg.solve_triangular(R, Q.T, trans="N", check_finite=False).T)


def _shrunk(G: FloatArray, m: int) -> FloatArray:
    """Gram matrix (k, k) with cosines clipped to 1/sqrt(m) in magnitude (Eq. 29, which prints 1/m
    without the root)."""
    bound = 1.0 / np.sqrt(m)
    H = np.clip(G, -bound, bound)
    np.fill_diagonal(H, np.diag(G))
    return H

