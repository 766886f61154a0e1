"""Orthogonal matching pursuit."""

from math import sqrt

import numpy as np
from pydantic import Field
from scipy.linalg import blas, solve_triangular

from sparsemor.core import FloatArray
from sparsemor.plugins.sparse_solvers.newton_on_supports import LinearRecovery, Recovered
from sparsemor.plugins.sparse_solvers.penalised import DEPENDENT, Penalised


class OrthogonalMatchingPursuit(LinearRecovery):
    """Orthogonal matching pursuit: adds the column that correlates most with the residual.

    A group with as many active columns as its budget gets no more. Own implementation with an
    updated QR factorisation: that of scikit-learn has neither budgets by group nor columns that are
    always active, and works on the Gram matrix, which squares the condition number. Pati, Rezaiifar
    and Krishnaprasad 1993, doi 10.1109/ACSSC.1993.342465; Tropp 2004, doi 10.1109/TIT.2004.834793.
    """

    tolerance: float = Field(default=1e-12, ge=0.0, lt=1.0)
    """Residual norm, relative to the right-hand side, at which no more columns are added."""

    @property
    def keeps_largest(self) -> bool:
        return True

    def recover(self, problem: Penalised) -> Recovered:
        """Coefficients x (k,) of least squares on the chosen columns."""
        A, b = problem.A, problem.b
        room = [g.budget or 0 for g in problem.groups]
        most = min(problem.size, sum(room))
        # columns without their parts along the chosen ones; chosen and refused columns are zero
        W = np.array(A, order="F")
        # orthonormal directions Q of the n chosen columns, H[:n] = Q^T times all columns before
        # they are projected, shares[:n] = Q^T b; room: further columns that each group may get
        Q, H = np.empty((problem.size, most), order="F"), np.empty((most, A.shape[1]))
        chosen: list[int] = []
        r, left, shares = b, sqrt(float(b.dot(b))), np.empty(most)
        least = self.tolerance * left
        while len(chosen) < most and left > least:
            correlation, n = r.dot(W), len(chosen)
            j = int(blas.idamax(correlation))  # largest magnitude
            if correlation[j] == 0.0:
                break
            q = W[:, j].copy()
            size = sqrt(float(q.dot(q)))
            if size <= DEPENDENT:
                W[:, j] = 0.0
                continue
            q /= size
            # once loses orthogonality between nearly parallel columns
            q -= Q[:, :n].dot(q.dot(Q[:, :n]))
            q /= sqrt(float(q.dot(q)))
            h = q.dot(W)
            W = blas.dger(-1.0, q, h, a=W, overwrite_a=1)
            W[:, j] = 0.0
            Q[:, n], H[n] = q, h
            shares[n] = q.dot(r)
            r = r - shares[n] * q
            left = sqrt(float(r.dot(r)))
            chosen.append(j)
            self._close(problem, j, room, W)  # no more columns of a group whose budget is spent
        return Recovered(_coefficients(A.shape[1], chosen, H, shares))

    def _close(self, problem: Penalised, j: int, room: list[int], W: FloatArray) -> None:
        """Counts column j in its group; a group with as many active columns as its budget gets no
        more."""
        for i, g in enumerate(problem.groups):
            if g.start <= j < g.stop:
                room[i] -= 1
                if room[i] == 0:
                    W[:, g.start : g.stop] = 0.0


def _coefficients(
    k: int, chosen: list[int], H: FloatArray, shares: FloatArray
) -> FloatArray:
    """Coefficients x (k,) of the chosen columns; H (n, k): their orthonormal directions times all
    columns; shares (n,): these directions times the right-hand side."""
    x, n = np.zeros(k), len(chosen)
    if n:
        x[chosen] = solve_triangular(H[:n, chosen], shares[:n])
    return x
