"""Projection of a term that is evaluated element by element: only elements at sampled rows are
visited."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.protocols.term import DelegatingTerm, Term, Trial


@dataclass(frozen=True, slots=True, eq=False)
class CompressedLocal(DelegatingTerm):
    """Projected term left @ term(offset + atoms xi), restricted to the rows where `left` has
    nonzero columns."""

    term: Term
    atoms: FloatArray
    offset: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, term: Term, trial: Trial, left: FloatArray) -> "CompressedLocal":
        rows = np.flatnonzero(np.any(left != 0, axis=0))
        restricted = term.restrict(rows)
        at = np.searchsorted(term.columns, restricted.columns)
        return cls(restricted, trial.atoms[at], trial.offset[at], left[:, rows])

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        T = self.atoms
        return self.left @ self.term.residual(self.offset + T @ x, T @ v, T @ a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        """Projected Jacobian left @ J @ atoms (`_seen`). Where the rate factors c1, c2 (k,) differ
        from atom to atom, it is the sum of three Jacobians: by x, by v and by a."""
        T = self.atoms
        full = self.offset + T @ x, T @ v, T @ a, t
        k1, k2 = self._spread(c1), self._spread(c2)
        if k1 is not None and k2 is not None:
            return self._seen(self.term.jacobian(*full, k1, k2))
        # derivatives K, K + C and K + M, with K, C, M those by x, v and a
        zero, one = np.zeros(len(self.offset)), np.ones(len(self.offset))
        fixed, of_v, of_a = (self._seen(self.term.jacobian(*full, i, j))
                             for i, j in ((zero, zero), (one, zero), (zero, one)))
        return np.asarray(fixed + (of_v - fixed) * c1 + (of_a - fixed) * c2)

    def _seen(self, J: Csr) -> FloatArray:
        """Projected Jacobian left @ J @ atoms; empty rows of J are skipped."""
        some = np.flatnonzero(np.diff(J.indptr))
        return np.asarray(self.left[:, some] @ np.asarray(J[some] @ self.atoms))

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Reason why the unprojected term rejects the end of a time step of about h (s), "" if it
        accepts."""
        T = self.atoms
        return self.term.check_step(self.offset + T @ x, T @ v, t, h)

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]:
        return self.term.resultants(self.offset + self.atoms @ x, self.atoms @ v, t)

    def _spread(self, c: FloatArray) -> FloatArray | None:
        """Factor of each column of the term from factors c (k,) of the atoms; None if atoms with
        different factors contribute to one column."""
        if not len(c) or c.min() == c.max():
            return np.full(len(self.offset), float(c[0]) if len(c) else 0.0)
        used = self.atoms != 0
        low, high = (np.where(used, c, fill) for fill in (np.inf, -np.inf))
        factor = high.max(axis=1)
        free = ~used.any(axis=1)
        same = bool(np.all((low.min(axis=1) == factor) | free))
        return np.where(free, 0.0, factor) if same else None
