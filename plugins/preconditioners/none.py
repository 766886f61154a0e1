"""No preconditioner: the sampled rows of the equations are not combined or scaled."""

import numpy as np

from sparsemor.core import (
    FloatArray,
    Preconditioner,
)


class NoPreconditioner(Preconditioner):
    """No preconditioning: P = I, the sampled equations are used as they are."""

    def check(self, rows: int, atoms: int) -> str:
        return ""

    def build(self, A: FloatArray) -> FloatArray:
        """Identity matrix (m, m) for sampled rows A (m, k)."""
        return np.eye(A.shape[0])
