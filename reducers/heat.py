"""One body's thermal block inside a step: C T' + K T - Q(t) + local terms = 0.

The coupling is one way (T drives u), so it is solved first. Without local terms it is linear and
one solve; local terms (radiation) are iterated with the constant part's factor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols import ReducedTerm, Term
from sparsemor.core.separable import HeatBody, evaluate_amplitudes
from sparsemor.core.status import Status
from sparsemor.reducers.test_map import TestedHeat


class HeatOutcome(NamedTuple):
    T: FloatArray
    status: Status
    iterations: int


class HeatBlock(Protocol):
    @property
    def active(self) -> IntArray | None: ...
    @property
    def elements(self) -> int:
        """Elements that one evaluation of its local terms visits."""
        ...

    def solve(self, r1: FloatArray, t: float, guess: FloatArray) -> HeatOutcome: ...


@dataclass(frozen=True, slots=True, eq=False)
class LocalAt:
    """A local term of the block: positions of its rows and columns in the block."""

    term: Term
    rows: IntArray
    columns: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class FullHeat:
    """Full order: a factor of B = c1 C + K."""

    heat: HeatBody
    c1: float
    factor: Any
    local: tuple[LocalAt, ...]
    active: IntArray | None = None
    rtol: float = 1e-13
    max_iterations: int = 50

    @property
    def elements(self) -> int:
        return sum(at.term.elements for at in self.local)

    def _right(self, r1: FloatArray, t: float) -> FloatArray:
        b = self.heat.constant - self.heat.capacity @ r1
        if self.heat.amplitudes:
            b = b + self.heat.loads @ evaluate_amplitudes(self.heat.amplitudes, t)
        return np.asarray(b)

    def solve(self, r1: FloatArray, t: float, guess: FloatArray) -> HeatOutcome:
        b = self._right(r1, t)
        if not self.local:
            return HeatOutcome(self.factor.solve(b), Status.DONE, 1)
        T, last = guess.copy(), np.inf
        for i in range(1, self.max_iterations + 1):
            r = b.copy()
            for at in self.local:
                x = T[at.columns]
                v = self.c1 * x + r1[at.columns]
                r[at.rows] -= at.term.residual(x, v, np.zeros_like(v), t)
            new = self.factor.solve(r)
            step, size = float(np.abs(new - T).max()), float(np.abs(new).max())
            T = new
            # stop on the step; it shrinks by the same factor each time, so the rest is smaller
            if not np.isfinite(step):
                return HeatOutcome(T, Status.NOT_FINITE, i)
            if step <= self.rtol * size or (step >= 0.5 * last and step <= 1e3 * self.rtol * size):
                return HeatOutcome(T, Status.DONE, i)
            last = step
        return HeatOutcome(T, Status.NOT_CONVERGED, self.max_iterations)


@dataclass(frozen=True, slots=True, eq=False)
class CompressedHeat:
    """s active atoms. history (s, k + j) maps [r1; amplitudes] to the linear solution."""

    history: FloatArray
    base: FloatArray
    amplitudes: tuple[Any, ...]
    active: IntArray | None
    local: tuple[ReducedTerm, ...]
    c1: float
    rtol: float = 1e-13
    max_iterations: int = 50

    @property
    def elements(self) -> int:
        return sum(term.elements for term in self.local)

    @classmethod
    def of(
        cls, b: TestedHeat, left: FloatArray, support: IntArray | None, c1: float,
        local: Sequence[ReducedTerm] = (),
    ) -> "CompressedHeat":
        """left (s, m) with left @ B_S = 1; local terms come already times `left`."""
        return cls(np.hstack([-left @ b.capacity, left @ b.loads]), left @ b.constant,
                   b.amplitudes, support, tuple(local), c1)

    def solve(self, r1: FloatArray, t: float, guess: FloatArray) -> HeatOutcome:
        given = np.concatenate((r1, evaluate_amplitudes(self.amplitudes, t)))
        base = self.history.dot(given) + self.base
        if not self.local:
            return HeatOutcome(base, Status.DONE, 1)
        return self._iterate(base, r1, t, guess)

    def _iterate(
        self, base: FloatArray, r1: FloatArray, t: float, guess: FloatArray
    ) -> HeatOutcome:
        use = slice(None) if self.active is None else self.active
        full = np.zeros(len(r1))
        c, one = guess.copy(), np.eye(len(base))
        zero, c1 = np.zeros(len(r1)), np.full(len(r1), self.c1)
        for i in range(1, self.max_iterations + 1):
            full[use] = c
            r, J = c - base, one
            for term in self.local:
                r = r + term.residual(full, zero, zero, t)
                J = J + term.jacobian(full, zero, zero, t, c1, zero)[:, use]
            if not np.isfinite(r).all():
                return HeatOutcome(c, Status.NOT_FINITE, i)
            step = np.linalg.solve(J, r)
            c = c - step
            if float(np.abs(step).max()) <= self.rtol * float(np.abs(c).max()):
                return HeatOutcome(c, Status.DONE, i)
        return HeatOutcome(c, Status.NOT_CONVERGED, self.max_iterations)
