"""Radiation between patches of surfaces, as heat in the rows of temperatures.

    q = G T^4 + g T_a(t)^4,   T = W x + given(t),   rows: shares q

with the mean temperatures T (P,) of the patches, K, and the heat q that leaves them, W/m2. Reduced
models contain W and the shares projected, and evaluate the patches alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core import Amplitude, Csr, FloatArray, IntArray, ReducedTerm, Term, Trial


@dataclass(frozen=True, slots=True, eq=False)
class Exchange:
    """Net heat q (P,), W/m2, that patches at temperatures T (P,), K, lose.

    G (P, P), g (P,), W/(m2 K^4): grey exchange with each other and with the surroundings at T_a;
    given: shapes (P,) and functions of time of the parts of T that are prescribed.
    """

    G: FloatArray
    g: FloatArray
    surroundings: Amplitude
    given: Sequence[tuple[FloatArray, Amplitude]]

    def temperatures(self, T: FloatArray, t: float) -> FloatArray:
        for shape, f in self.given:
            T = T + shape * f(t)
        return T

    def heat(self, T: FloatArray, t: float) -> FloatArray:
        return self.G @ T**4 + self.g * self.surroundings(t) ** 4

    def slope(self, T: FloatArray) -> FloatArray:
        return 4.0 * self.G * T**3


@dataclass(frozen=True, slots=True, eq=False)
class CavityTerm(Term):
    """Heat lost by radiation in the rows of temperatures. W (P, n): mean temperatures of the
    patches; shares (m, P): area, m2, of each patch at each row."""

    rows: IntArray
    columns: IntArray
    exchange: Exchange
    W: FloatArray
    shares: FloatArray
    source: str = ""

    @property
    def elements(self) -> int:
        return len(self.W)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        T = self.exchange.temperatures(self.W @ x, t)
        return np.asarray(self.shares @ self.exchange.heat(T, t))

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        T = self.exchange.temperatures(self.W @ x, t)
        return csr_array(self.shares @ self.exchange.slope(T) @ self.W)

    def restrict(self, keep: IntArray) -> Self:
        return replace(self, rows=self.rows[keep], shares=self.shares[keep])

    def compress(self, trial: Trial, left: FloatArray) -> "ReducedCavity":
        return ReducedCavity(self.exchange, self.W @ trial.atoms, self.W @ trial.offset,
                             left @ self.shares, self.source)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedCavity(ReducedTerm):
    """Projected radiation: W (P, k), mean temperatures at the offset (P,), shares (l, P)."""

    exchange: Exchange
    W: FloatArray
    offset: FloatArray
    shares: FloatArray
    source: str = ""

    @property
    def elements(self) -> int:
        return len(self.W)

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        T = self.exchange.temperatures(self.offset + self.W @ x, t)
        return np.asarray(self.shares @ self.exchange.heat(T, t))

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        T = self.exchange.temperatures(self.offset + self.W @ x, t)
        return np.asarray(self.shares @ self.exchange.slope(T) @ self.W)
