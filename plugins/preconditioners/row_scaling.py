"""Row scaling preconditioner: rows of unit length."""

import numpy as np

from sparsemor.core import (
    FloatArray,
    Preconditioner,
)


class RowScaling(Preconditioner):
    """Row scaling: P = diag(1 / |row|), so that all sampled equations have equal weight.

    Then the condition number of P A is at most sqrt(m) times the least over all diagonal P, A (m,
    k) the sampled rows (van der Sluis 1969, doi 10.1007/BF02165096, applied to rows). Defined for
    every shape.
    """

    def check(self, rows: int, atoms: int) -> str:
        return ""

    def build(self, A: FloatArray) -> FloatArray:
        """Preconditioner P (m, m) for sampled rows A (m, k). Rows that are round-off of the largest
        one are not scaled up."""
        norms = np.linalg.norm(A, axis=1)
        largest = norms.max(initial=0.0)
        if largest == 0.0:
            return np.eye(A.shape[0])
        empty = norms <= A.shape[1] * np.finfo(np.float64).eps * largest
        return np.diag(1.0 / np.where(empty, largest, norms))
