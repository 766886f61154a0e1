"""A local term under trial and test maps: only the elements at its kept rows are visited."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols import Term, Trial


@dataclass(frozen=True, slots=True, eq=False)
class CompressedLocal:
    """left @ term(offset + atoms xi), the term restricted to the rows that `left` reads."""

    term: Term
    atoms: FloatArray
    offset: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, term: Term, trial: Trial, left: FloatArray) -> "CompressedLocal":
        used = np.flatnonzero(np.any(left != 0, axis=0))
        kept = term.restrict(used)
        at = np.searchsorted(term.columns, kept.columns)
        return cls(kept, trial.atoms[at], trial.offset[at], left[:, used])

    @property
    def elements(self) -> int:
        return self.term.elements

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        T = self.atoms
        return self.left @ self.term.residual(self.offset + T @ x, T @ v, T @ a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        T, n = self.atoms, len(self.offset)
        k1, k2 = (np.full(n, float(np.max(c, initial=0.0))) for c in (c1, c2))
        J = self.term.jacobian(self.offset + T @ x, T @ v, T @ a, t, k1, k2)
        return np.asarray(self.left @ np.asarray(J @ T))
