"""Orthogonal matching pursuit."""

import numpy as np
from pydantic import Field
from scipy.linalg import solve_triangular

from sparsemor.core import FloatArray
from sparsemor.plugins.sparse_solvers.newton import LinearRecovery, Recovered
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

    def recover(self, problem: Penalised) -> Recovered:
        """Coefficients x (k,) of least squares on the chosen columns."""
        A, b = problem.A, problem.b
        open_, room = np.linalg.norm(A, axis=0) > 0.0, [g.budget or 0 for g in problem.groups]
        owner = np.repeat(np.arange(len(room)), [g.stop - g.start for g in problem.groups])
        most = min(problem.size, sum(room))
        Q, R = np.empty((problem.size, most), order="F"), np.zeros((most, most))
        chosen: list[int] = []
        r, least = b, self.tolerance * float(np.linalg.norm(b))
        while len(chosen) < most and float(np.linalg.norm(r)) > least:
            correlation = np.where(open_, np.abs(r @ A), 0.0)
            j, n = int(np.argmax(correlation)), len(chosen)
            if not correlation[j] > 0.0:
                break
            open_[j] = False
            q = A[:, j]
            for _ in range(2):  # once loses orthogonality between nearly parallel columns
                h = q @ Q[:, :n]
                q, R[:n, n] = q - Q[:, :n] @ h, R[:n, n] + h
            size = float(np.linalg.norm(q))
            if size <= DEPENDENT:
                R[:n, n] = 0.0
                continue
            Q[:, n], R[n, n] = q / size, size
            r = r - Q[:, n] * (Q[:, n] @ r)
            chosen.append(j)
            room[owner[j]] -= 1
            if room[owner[j]] == 0:
                open_[owner == owner[j]] = False
        return Recovered(_coefficients(A.shape[1], chosen, Q, R, b))


def _coefficients(
    k: int, chosen: list[int], Q: FloatArray, R: FloatArray, b: FloatArray
) -> FloatArray:
    x, n = np.zeros(k), len(chosen)
    if n:
        x[chosen] = solve_triangular(R[:n, :n], b @ Q[:, :n])
    return x
