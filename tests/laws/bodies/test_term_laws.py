"""The term laws accept a correct nonlinear term and refuse each way to get it wrong."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from scipy import sparse

from sparsemor.core import ReducedTerm, Term, Trial
from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.testing import check_term


@dataclass(frozen=True)
class Mixed(Term):
    """K x + D v + M a + x_i^3 on each row's first column, times cos t."""

    rows: IntArray
    columns: IntArray
    K: Any
    D: Any
    M: Any
    fault: str = ""

    @property
    def elements(self) -> int:
        return int(self.rows.size) + (5 if self.fault == "more elements" else 0)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        if self.fault == "writes":
            x += 1.0
        return np.asarray(np.cos(t) * (self.K @ x + self.D @ v + self.M @ a + self.K @ x**3))

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        J = self.K + self.D * c1 + self.M * c2 + self.K * (3.0 * x**2)
        if self.fault == "forgets the rate":
            J = J - self.D * c1
        if self.fault == "forgets the time":
            return sparse.csr_array(J)
        return sparse.csr_array(np.cos(t) * J)

    def restrict(self, keep: IntArray) -> Term:
        parts = [np.asarray(A)[keep] for A in (self.K, self.D, self.M)]
        if self.fault == "other rows" and keep.size:
            parts[0] = parts[0][::-1] * 2.0
        seen = np.flatnonzero(np.any([(A != 0.0).any(axis=0) for A in parts], axis=0))
        rows = self.rows[keep] + (1 if self.fault == "row numbers" else 0)
        K, D, M = (A[:, seen] for A in parts)
        small = Mixed(rows, self.columns[seen], K, D, M)
        return replace(small, fault=self.fault) if self.fault == "more elements" else small

    def compress(self, trial: Trial, left: FloatArray) -> ReducedTerm:
        if self.fault == "forgets the offset":
            trial = Trial(trial.atoms, 0.0 * trial.offset)
        return Compressed(self, trial, left)


@dataclass(frozen=True)
class Compressed(ReducedTerm):
    term: Mixed
    trial: Trial
    left: FloatArray

    def _full(self, x: FloatArray, v: FloatArray, a: FloatArray) -> tuple[FloatArray, ...]:
        Z = self.trial.atoms
        return self.trial.offset + Z @ x, Z @ v, Z @ a

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        X, V, A = self._full(x, v, a)
        return np.asarray(self.left @ self.term.residual(X, V, A, t))

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        X, Z, T = self._full(x, v, a)[0], self.trial.atoms, self.term
        J = (T.K + T.K * (3.0 * X**2)) @ Z + T.D @ Z * c1
        if T.fault != "compresses no inertia":
            J = J + T.M @ Z * c2
        return np.asarray(np.cos(t) * self.left @ J)


def mixed(fault: str = "") -> Mixed:
    rng = np.random.default_rng(0)
    K, D, M = rng.standard_normal((3, 6, 9)) * (rng.random((6, 9)) < 0.5)
    rows = np.arange(10, 16, dtype=np.int64)
    columns = np.arange(2, 20, 2, dtype=np.int64)
    return Mixed(rows, columns, K, D, M, fault)


def test_a_correct_term_keeps_the_laws() -> None:
    check_term(mixed(), np.random.default_rng(1))
    check_term(mixed(), np.random.default_rng(2), base=np.full(9, 293.0), scale=10.0)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("forgets the rate", "central difference"),
        ("forgets the time", "central difference"),
        ("writes", "wrote to its arguments"),
        ("other rows", "differs from residual"),
        ("row numbers", "rows must be rows"),
        ("more elements", "more elements"),
        ("forgets the offset", "left @ residual"),
        ("compresses no inertia", "left @ jacobian @ atoms"),
    ],
)
def test_a_broken_term_fails_its_law(fault: str, words: str) -> None:
    term = mixed(fault)
    if fault == "more elements":
        term = replace(term, fault="")
        object.__setattr__(term, "restrict", lambda keep: mixed(fault).restrict(keep))
    with pytest.raises(AssertionError, match=words):
        check_term(term, np.random.default_rng(1))
