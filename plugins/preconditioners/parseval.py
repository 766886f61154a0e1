"""Parseval frame preconditioner: orthonormal rows."""

import numpy as np

from sparsemor.core import FloatArray, InputError, Preconditioner
from sparsemor.core.linalg.dense import svd


class Parseval(Preconditioner):
    """Parseval frame: P = (A A^T)^(-1/2), so that the rows of P A are orthonormal.

    A (m, k) are the sampled rows of the linear equations for k coefficients; the rows of P A are
    the orthonormal ones nearest to them. P A is the canonical Parseval frame of A's columns: its
    singular values are all 1, so a least-squares fit weighs all combinations of rows equally
    (Casazza and Kutyniok, Finite Frames, 2013, doi 10.1007/978-0-8176-8373-3, Sec. 1.5). Column
    norms stay unequal.
    """

    def check(self, rows: int, atoms: int) -> str:
        if atoms >= rows:
            return ""
        return (
            f"parseval needs independent rows, so at least as many atoms as rows: {atoms} atoms < "
            f"{rows} rows; take at least {rows} atoms, at most {atoms} rows, or preconditioner: "
            "row_scaling or none"
        )

    def build(self, A: FloatArray) -> FloatArray:
        """Preconditioner P = (A A^T)^(-1/2), (m, m), for A (m, k), k >= m. Raises InputError when
        k < m or A lacks row rank."""
        m, k = A.shape
        reason = self.check(m, k)
        if reason:
            raise InputError(reason)
        # by singular values: A A^T would square the condition number
        U, s, _ = svd(A)
        rank = int(np.count_nonzero(s > k * np.finfo(np.float64).eps * s.max(initial=0.0)))
        if rank < m:
            raise InputError(
                f"parseval needs {m} independent rows, but the sampled rows of the {k} atoms have "
                f"rank {rank}: take fewer rows, more atoms, or another sampler"
            )
        return np.asarray((U / s) @ U.T)
