"""Local terms of few unknowns with dense derivatives."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core import Csr, FloatArray, IntArray, ReducedTerm, Term, Trial

Evaluation = tuple[FloatArray, FloatArray, FloatArray]
Law = Callable[[FloatArray, FloatArray, float], Evaluation]
"""Function of x, v (n,), at the term's columns, and time, s: returns the residual (m,) and its
derivatives (m, n) by x and by v."""


@dataclass(frozen=True, slots=True, eq=False)
class ReducedDense(ReducedTerm):
    """Projected dense term left @ law(offset + atoms xi), with k reduced unknowns xi (here x):
    law(x, v, t) returns the residual (m,) and its derivatives (m, n) by x and by v; trial: atoms
    (n, k), offset (n,); left (l, m). c1 (k,): dv = c1 dx."""

    law: Law
    trial: Trial
    left: FloatArray

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return np.asarray(self.left @ self._at(x, v, t)[0])

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        _, by_x, by_v = self._at(x, v, t)
        T = self.trial.atoms
        return np.asarray(self.left @ by_x @ T + (self.left @ by_v @ T) * c1)

    def _at(self, x: FloatArray, v: FloatArray, t: float) -> Evaluation:
        T = self.trial.atoms
        return self.law(self.trial.offset + T @ x, T @ v, t)


@dataclass(frozen=True, slots=True, eq=False)
class DenseTerm(Term):
    """Term of a few unknowns: a spring, a damper, a contact of two points.

    rows (m,), columns (n,): positions in the state vector; law(x, v, t): residual (left-hand side:
    minus the force) and its derivatives by x and v, for all rows before any `restrict`. keep:
    numbers of the remaining rows, None for all. source: name of the part of the scene, set in
    assembly.
    """

    rows: IntArray
    columns: IntArray
    law: Law
    keep: IntArray | None = None
    source: str = ""

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self._kept(x, v, t)[0]

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        _, by_x, by_v = self._kept(x, v, t)
        return csr_array(by_x + by_v * c1)

    def restrict(self, keep: IntArray) -> Self:
        before = np.arange(len(self.rows)) if self.keep is None else self.keep
        return replace(self, rows=self.rows[keep], keep=before[keep])

    def compress(self, trial: Trial, left: FloatArray) -> ReducedDense:
        return ReducedDense(self._kept, trial, left)

    def _kept(self, x: FloatArray, v: FloatArray, t: float) -> Evaluation:
        r, by_x, by_v = self.law(x, v, t)
        return (r, by_x, by_v) if self.keep is None else (
            r[self.keep], by_x[self.keep], by_v[self.keep])
