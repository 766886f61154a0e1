"""One elastic block on a frame whose motion is given: linear, and nothing rigid to feed.

With D = K + c1 D_m + c2 M constant, its rows times D^-1 read

    u + sum_g kappa_g D^-1 M_g u = b,   b = -D^-1 (h + P sigma + sum_g mu_g M_g r1),

h the history of the step and given loads, P the directions. sigma, kappa and mu follow from the
time alone (core/separable.py), so moments and quadratic forms of u are not needed.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.block_solvers import short, solved
from sparsemor.core.protocols import Factorized
from sparsemor.core.separable import ElasticOperators, FrameWork, evaluate_amplitudes
from sparsemor.core.tables import total
from sparsemor.reducers.elastic import History
from sparsemor.reducers.felt import Moving, felt
from sparsemor.reducers.test_map import TestedElastic

POWER, MARGIN = 8, 2.0
"""Steps of the power method that estimates how much M counts beside D, and the margin on it."""


class Past(History):
    """One step's constants. kappa, mu (g,); u: the last iterate's image, c: that iterate, None at
    the start; r1: what mu acts on, None when that is done."""

    __slots__ = ("c", "kappa", "mu", "r1", "u")

    def __init__(self, work: FrameWork, r1: FloatArray) -> None:
        super().__init__()
        g = len(work.coefficients) // 2
        self.kappa, self.mu = work.coefficients[:g].tolist(), work.coefficients[g:-1].tolist()
        self.r1: FloatArray | None = r1
        self.c: FloatArray | None = None

    kappa: list[float]
    mu: list[float]
    u: FloatArray


class DrivenBlock(ABC):
    """`active`: numbers of the unknowns it solves for, None for all."""

    active: IntArray | None

    @abstractmethod
    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, work: FrameWork
    ) -> Past: ...

    @abstractmethod
    def improve(self, c: FloatArray, past: Past) -> FloatArray:
        """b - sum_g kappa_g D^-1 M_g c: one step of the iteration."""

    @abstractmethod
    def contraction(self, past: Past) -> float:
        """An estimate, on the safe side, of the factor by which `improve` shrinks an error."""


@dataclass(frozen=True, slots=True, eq=False)
class FullDriven(DrivenBlock):
    """Full order: D made ready, one right-hand side an iteration. softness: the largest
    eigenvalue of D^-1 M, where M_g turns."""

    ops: ElasticOperators
    factor: Factorized
    softness: float
    active: IntArray | None = None

    @classmethod
    def of(cls, ops: ElasticOperators, factor: Factorized, block: str) -> "FullDriven":
        """Raises SolveFailed, naming the block, where an iteration stops short."""
        return cls(ops, factor, softness(ops, factor, block) if ops.generators else 0.0)

    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, work: FrameWork
    ) -> Past:
        o, past = self.ops, Past(work, r1)
        h = o.mass @ r2 - o.constant
        if o.damping.nnz:
            h += o.damping @ r1
        if o.coupling is not None:
            h -= o.coupling @ xT
        if o.amplitudes:
            h -= o.loads @ evaluate_amplitudes(o.amplitudes, t)
        if o.tables:
            h -= total(o.tables, t)
        sigma = work.sigma[-1]
        if sigma.any():
            h += o.directions @ sigma
        for M, mu in zip(o.generators, past.mu, strict=True):
            if mu:
                h += M @ (mu * r1)
        past.h = h
        return past

    def improve(self, c: FloatArray, past: Past) -> FloatArray:
        right = past.h
        for M, kappa in zip(self.ops.generators, past.kappa, strict=True):
            if kappa:
                right = right + M @ (kappa * c)
        if not self.factor.iterative:
            return -self.factor.solve(right)
        found = self.factor.outcome(right, -c)
        past.iterations += found.iterations
        if found.status.ok:
            return -found.x
        past.failure = found.status, short(self.factor, found.residual, found.iterations)
        return np.full(len(right), np.nan)

    def contraction(self, past: Past) -> float:
        return self.softness * sum(map(abs, past.kappa))


@dataclass(frozen=True, slots=True, eq=False)
class CompressedDriven(DrivenBlock):
    """s active atoms: every operator is dense, small and prepared; no length of the mesh is left.

    H: what b is made of (s, [k] + k + kt + j + p), of [r1], r2, xT, amplitudes and sigma, where r1
    is left out without damping; G (g, s, k): D^-1 M_g with Frobenius norms `sizes` (g,).
    """

    H: FloatArray
    base: FloatArray
    G: FloatArray
    sizes: tuple[float, ...]
    damped: bool
    active: IntArray | None
    amplitudes: tuple[Any, ...]
    tables: tuple[Moving, ...] = ()

    @classmethod
    def of(
        cls, b: TestedElastic, left: FloatArray, support: IntArray | None
    ) -> "CompressedDriven":
        """left (s, m): what turns tested rows into D^-1 times the rows, left @ D_S = 1."""
        damped = bool(b.damping.any())
        parts = [*([-b.damping] if damped else []), -b.mass, b.coupling, b.loads, -b.directions]
        G = np.stack([left @ A for A in b.generators]) if len(b.generators) else np.zeros(
            (0, len(left), b.mass.shape[1]))
        use = slice(None) if support is None else support
        return cls(np.ascontiguousarray(left @ np.hstack(parts)), -left @ b.constant, G,
                   tuple(float(np.linalg.norm(A[:, use])) for A in G), damped, support,
                   b.amplitudes, felt(b.tables, left, support is None))

    def rates(self, k: int) -> tuple[FloatArray, FloatArray]:
        """(s, k) each, k atoms: D^-1 D_m and D^-1 M, the block's own answer to -r1 and -r2."""
        if self.damped:
            return -self.H[:, :k], -self.H[:, k : 2 * k]
        return np.zeros((len(self.H), k)), -self.H[:, :k]

    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, work: FrameWork
    ) -> Past:
        past = Past(work, r1)
        parts = [r1, r2, xT] if self.damped else [r2, xT]
        if self.amplitudes:
            parts.append(evaluate_amplitudes(self.amplitudes, t))
        parts.append(work.sigma[-1])
        past.u = self.H.dot(np.concatenate(parts)) + self.base
        if self.tables:
            past.u += total(self.tables, t)
        return past

    def improve(self, c: FloatArray, past: Past) -> FloatArray:
        d = c if past.c is None else c - past.c  # only what is new is multiplied
        if self.active is not None:
            wide = np.zeros(self.G.shape[2])
            wide[self.active] = d
            d = wide
        u, r1 = past.u, past.r1
        for G, kappa, mu in zip(self.G, past.kappa, past.mu, strict=True):
            if mu and r1 is not None:
                u = u - G.dot(kappa * d + mu * r1)
            elif kappa:
                u = u - G.dot(kappa * d)
        past.c, past.u, past.r1 = c, u, None
        return u

    def contraction(self, past: Past) -> float:
        return sum(abs(k) * size for k, size in zip(past.kappa, self.sizes, strict=True))


def softness(ops: ElasticOperators, factor: Factorized, block: str) -> float:
    """The largest eigenvalue of D^-1 M, s^2, by the power method, with a margin."""
    x, found = np.random.default_rng(0).standard_normal(len(ops.constant)), 0.0
    for _ in range(POWER):
        Mx = ops.mass @ x
        y = solved(factor, Mx, block)
        found = float(y @ Mx) / float(x @ Mx)
        x = y / np.linalg.norm(y)
    return MARGIN * found
