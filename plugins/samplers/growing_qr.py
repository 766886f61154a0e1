"""The triangular factor of rows chosen so far: what singular values need, at the atoms' size."""

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.core.linalg.svd import svd

EPS = float(np.finfo(np.float64).eps)
LOST = 1e4
"""What is updated from row to row and has shrunk by this factor has lost four digits of it: it is
computed afresh."""


class RowFactor:
    """R with R^T R = A^T A for rows A (p, k) that grow; R has at most k rows.

    Kept by QR, not as A^T A, whose small eigenvalues are lost at 1e-8 of the largest.
    """

    def __init__(self, A: FloatArray) -> None:
        self.R = _triangle(A)

    def add(self, rows: FloatArray) -> None:
        """More rows (q, k)."""
        self.R = _triangle(np.vstack([self.R, rows]))

    def singular(self, columns: int) -> tuple[FloatArray, FloatArray, int]:
        """s, V (j, j) and rank of the first j columns: singular values, right vectors in columns.

        s has min(p, j) entries; columns of V from `rank` on span what the rows do not see.
        """
        j = columns
        if self.R.shape[0] == 0:
            return np.zeros(0), np.eye(j), 0
        _, s, Vt = svd(self.R[:j, :j], full_matrices=True)
        return s, Vt.T, int(np.count_nonzero(s > EPS * j * s[0]))


def _triangle(A: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.qr(A, mode="r"), dtype=np.float64)
