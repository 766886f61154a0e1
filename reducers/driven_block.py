"""One elastic block on a frame whose motion is given: linear, and nothing rigid to feed.

With D = K + c1 D_m + c2 M constant, its rows times D^-1 read

    u + sum_g kappa_g D^-1 M_g u = b,   b = -D^-1 (h + P sigma + sum_g mu_g M_g r1),

h the history of the step and given loads, P the directions. sigma, kappa and mu follow from the
time alone (core/separable.py), so moments and quadratic forms of u are not needed.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.block_solvers import short
from sparsemor.core.protocols import Factorized
from sparsemor.core.separable import ElasticOperators, evaluate_amplitudes
from sparsemor.core.tables import total
from sparsemor.reducers.elastic import History
from sparsemor.reducers.felt import Moving, felt
from sparsemor.reducers.known import Known
from sparsemor.reducers.natural import carried, dense, times
from sparsemor.reducers.softest import Softest
from sparsemor.reducers.test_map import TestedElastic

LEADING = (16, 64, 128)
"""How many soft modes are multiplied alone where the others no longer count."""


class Past(History):
    """One step's constants. kappa, mu (g,); u: the last iterate's image, c: that iterate, None at
    the start; r1: what mu acts on, None when that is done; reach: see `CompressedDriven`."""

    __slots__ = ("c", "kappa", "mu", "r1", "reach", "u")

    def __init__(self, known: FloatArray, g: int, r1: FloatArray) -> None:
        super().__init__()
        self.kappa, self.mu = known[:g].tolist(), known[g : 2 * g].tolist()
        self.r1: FloatArray | None = r1
        self.c: FloatArray | None = None

    kappa: list[float]
    mu: list[float]
    u: FloatArray
    reach: list[float]


class DrivenBlock(ABC):
    """`active`: numbers of the unknowns it solves for, None for all."""

    active: IntArray | None

    @abstractmethod
    def known(self, drive: Known) -> Known:
        """Of kappa, mu and sigma at all times: these, and what else time decides of a step."""

    @abstractmethod
    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, known: FloatArray
    ) -> Past:
        """known: what `known` has at t."""

    @abstractmethod
    def improve(self, c: FloatArray, past: Past, slack: float) -> FloatArray:
        """b - sum_g kappa_g D^-1 M_g c: one step of the iteration, right to `slack` (2-norm)."""

    @abstractmethod
    def contraction(self, past: Past) -> float:
        """An estimate, on the safe side, of the factor by which `improve` shrinks an error."""


@dataclass(frozen=True, slots=True, eq=False)
class FullDriven(DrivenBlock):
    """Full order: D made ready, one right-hand side an iteration, then its softest modes."""

    ops: ElasticOperators
    factor: Factorized
    softest: Softest
    active: IntArray | None = None

    @classmethod
    def of(cls, ops: ElasticOperators, factor: Factorized, block: str) -> "FullDriven":
        """Raises SolveFailed, naming the block, where an iteration stops short."""
        return cls(ops, factor, Softest.of(ops, factor, block))

    def known(self, drive: Known) -> Known:
        return drive

    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, known: FloatArray
    ) -> Past:
        o, g = self.ops, len(self.ops.generators)
        past = Past(known, g, r1)
        h = o.mass @ r2 - o.constant
        if o.damping.nnz:
            h += o.damping @ r1
        if o.coupling is not None:
            h -= o.coupling @ xT
        if o.amplitudes:
            h -= o.loads @ evaluate_amplitudes(o.amplitudes, t)
        if o.tables:
            h -= total(o.tables, t)
        sigma = known[2 * g :]
        if sigma.any():
            h += o.directions @ sigma
        for M, mu in zip(o.generators, past.mu, strict=True):
            if mu:
                h += M @ (mu * r1)
        past.h = h
        return past

    def improve(self, c: FloatArray, past: Past, slack: float) -> FloatArray:
        right = past.h
        for M, kappa in zip(self.ops.generators, past.kappa, strict=True):
            if kappa:
                right = right + M @ (kappa * c)
        if not self.factor.iterative:
            u = -self.factor.solve(right)
            return u + self.softest.correction(u - c, past.kappa) if any(past.kappa) else u
        found = self.factor.outcome(right, -c)
        past.iterations += found.iterations
        if found.status.ok:
            return -found.x
        past.failure = found.status, short(self.factor, found.residual, found.iterations)
        return np.full(len(right), np.nan)

    def contraction(self, past: Past) -> float:
        return self.softest.left * sum(map(abs, past.kappa))


@dataclass(frozen=True, slots=True, eq=False)
class CompressedDriven(DrivenBlock):
    """s active atoms: every operator is dense, small and prepared; no length of the mesh is left.

    What b is made of: inertia and damping times r2 and r1, (s, k) or diagonals (natural.py),
    damping None where there is none; coupling (s, kt) times xT; base; E (s, p) times sigma; loads
    (s, j) times amplitudes, and tables. G (g, s, k): the D^-1 M_g. reach (1 + 2 l, g): their
    Frobenius norms, those of all but their first r rows for each r of `levels` (l,), and those of
    these rows without their first r columns. No levels where some atoms are not active.
    """

    inertia: FloatArray
    damping: FloatArray | None
    coupling: FloatArray
    base: FloatArray
    E: FloatArray
    loads: FloatArray
    G: FloatArray
    levels: tuple[int, ...]
    reach: FloatArray
    active: IntArray | None
    amplitudes: tuple[Any, ...]
    tables: tuple[Moving, ...] = ()

    @classmethod
    def of(
        cls, b: TestedElastic, left: FloatArray, support: IntArray | None
    ) -> "CompressedDriven":
        """left (s, m): what turns tested rows into D^-1 times the rows, left @ D_S = 1."""
        G = np.stack([left @ A for A in b.generators]) if len(b.generators) else np.zeros(
            (0, len(left), b.mass.shape[1]))
        levels = tuple(r for r in LEADING if r < len(left)) if support is None else ()
        own = G if support is None else G[:, :, support]
        parts = [own, *(own[:, r:] for r in levels), *(own[:, :r, r:] for r in levels)]
        return cls(
            carried(-left @ b.mass), carried(-left @ b.damping) if b.damping.any() else None,
            np.ascontiguousarray(left @ b.coupling), -left @ b.constant, -left @ b.directions,
            left @ b.loads, G, levels, np.stack([np.sqrt((A**2).sum((1, 2))) for A in parts]),
            support, b.amplitudes, felt(b.tables, left, support is None))

    def rates(self, k: int) -> tuple[FloatArray, FloatArray]:
        """(s, k) each, k atoms: D^-1 D_m and D^-1 M, the block's own answer to -r1 and -r2."""
        none = np.zeros((len(self.base), k))
        return none if self.damping is None else -dense(self.damping), -dense(self.inertia)

    def known(self, drive: Known) -> Known:
        """kappa, mu, sigma and all of b that does not depend on unknowns."""
        g = 2 * len(self.G)

        def at(t: float) -> FloatArray:
            row = drive.at(t)
            b = self.base + self.E.dot(row[g:])
            if self.amplitudes:
                b += self.loads.dot(evaluate_amplitudes(self.amplitudes, t))
            if self.tables:
                b += total(self.tables, t)
            return np.concatenate((row, b))

        # a support that may change with the next step does not pay for all times
        return Known.of(at, np.array(drive.times)) if self.active is None else Known(at)

    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, known: FloatArray
    ) -> Past:
        g = len(self.G)
        past = Past(known, g, r1)
        past.reach = self.reach.dot(np.abs(known[:g])).tolist()
        past.u = times(self.inertia, r2) + known[2 * g + self.E.shape[1] :]
        if self.damping is not None:
            past.u += times(self.damping, r1)
        if len(xT):
            past.u += self.coupling.dot(xT)
        return past

    def improve(self, c: FloatArray, past: Past, slack: float) -> FloatArray:
        u, r1, r = past.u.copy(), past.r1, len(self.base)
        d = c if past.c is None else c - past.c  # only what is new is multiplied
        if self.levels and past.c is not None:  # and of that what counts
            r = self._counting(d, past.reach, slack)
        d = self._wide(d) if r == len(u) else d[:r]
        for G, kappa, mu in zip(self.G, past.kappa, past.mu, strict=True):
            if mu and r1 is not None:
                u -= G.dot(kappa * d + mu * r1)
            elif kappa:
                u[:r] -= G[:r, : len(d)].dot(kappa * d)
        past.c, past.u, past.r1 = c, u, None
        return u

    def _wide(self, d: FloatArray) -> FloatArray:
        """Of active unknowns, all of them."""
        if self.active is None:
            return d
        wide = np.zeros(self.G.shape[2])
        wide[self.active] = d
        return wide

    def _counting(self, d: FloatArray, reach: Sequence[float], slack: float) -> int:
        """How many first unknowns are enough of a change d where `slack` may be left out."""
        size, most = sqrt(float(d.dot(d))), len(self.levels)
        for i, r in enumerate(self.levels, 1):
            if reach[i] * size <= slack:
                beyond = d[r:]
                if reach[i] * size + reach[i + most] * sqrt(float(beyond.dot(beyond))) <= slack:
                    return r
        return len(d)

    def contraction(self, past: Past) -> float:
        return past.reach[0]
