"""No preconditioner: the sampled rows stay as they are."""

import numpy as np

from sparsemor.core import FloatArray, Plugin


class NoPreconditioner(Plugin):
    """No preconditioning: P = I."""

    def check(self, rows: int, atoms: int) -> str:
        return ""

    def build(self, A: FloatArray) -> FloatArray:
        """The identity (m, m) for A (m, k)."""
        return np.eye(A.shape[0])
