"""Elastic block of one body inside a step, with its elimination from the bordered Newton system.

With D = K + c1 D_m + c2 M constant (D_m: damping), the elastic rows times D^-1 read

    u + z + E sigma = 0,   z = D^-1 (h + sum_g kappa_g M_g u + mu_g M_g r1),   E = D^-1 P,

with h the terms of past states and loads, P the columns that couple to the frame ("directions"),
M_g constant matrices, and the scalars sigma, kappa, mu of the frame's motion. Full order solves
with the factorized D; a reduced block has D^-1 applied to all matrices in advance. The iteration is
the same for both.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sparsemor.core import (
    Amplitude,
    Csr,
    ElasticOperators,
    Factorized,
    FloatArray,
    IntArray,
    Status,
    evaluate_amplitudes,
    solve_or_fail,
    total_load,
    unconverged_note,
)
from sparsemor.reducers.step.acceptance import EPS, rounding
from sparsemor.reducers.step.elastic_local import (
    FullLocal,
    LocalForces,
    ReducedLocal,
    StepForces,
)
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.time_tables import Moving, plus_loads, tabulated


class History:
    """Constants of one elastic block in a step.

    h: terms of past states and loads; stack: their products for the sum over g; quad: rows M_g r1,
    then M_g r2; s1 = P^T r1, s2 = P^T r2; parts: r1, r2, temperatures and amplitudes of a reduced
    block; local: local terms, None where there are none. Of an iterative linear solver: its number
    of iterations in this step, its residual relative to the right-hand side, and status and message
    of a solve that did not converge.
    """

    __slots__ = (
        "failure", "h", "iterations", "local", "parts", "quad", "residual", "s1", "s2", "stack")

    def __init__(self) -> None:
        self.iterations, self.residual = 0, 0.0
        self.local: StepForces | None = None
        self.failure: tuple[Status, str] | None = None

    h: FloatArray
    parts: FloatArray
    stack: FloatArray
    quad: FloatArray
    s1: FloatArray
    s2: FloatArray


class Functionals(NamedTuple):
    """Products of the displacements u: s (p,) = P^T u, form (g,) = u.M_g u, forms (2 g,) = u.M_g
    (r1, r2), and M_g u at full order."""

    s: FloatArray
    form: FloatArray
    forms: FloatArray
    products: FloatArray | None


class DisplacementBlock(ABC):
    """Base class of one body's displacements in a step. active: numbers of the unknowns that are
    solved for, None for all; local: terms that are evaluated at each iterate."""

    active: IntArray | None
    local: LocalForces | None

    @property
    def iterates(self) -> bool:
        """True if its linear solver is iterative."""
        return False

    def rates(self, k: int) -> tuple[FloatArray, FloatArray] | None:
        """D^-1 D_m and D^-1 M on k atoms, (s, k) each for s active ones: minus the block's response
        to r1 and r2 without other terms; None at full order."""
        return None


class ElasticBlock(DisplacementBlock):
    """Displacements of a body whose frame has unknowns. G (p, p) = P^T D^-1 P."""

    G: FloatArray

    @abstractmethod
    def begin(self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float) -> History:
        """Constants of a step to t (s); xT: temperatures."""

    @abstractmethod
    def functionals(self, c: FloatArray, history: History) -> Functionals:
        """Products of the unknowns c with P and M_g."""

    @abstractmethod
    def combine(
        self, of: Functionals, history: History, factors: FloatArray, c: FloatArray,
        sigma: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """z and P^T z; factors (2 g + 1,) = [kappa, mu, 1]. -(c + E sigma) is the initial guess of
        an iterative linear solver."""

    @abstractmethod
    def update(self, z: FloatArray, sigma: FloatArray) -> FloatArray:
        """Unknowns of the block, -(z + E sigma)."""

    @abstractmethod
    def noise(
        self, c: FloatArray, history: History, factors: FloatArray, c1: float, c2: float
    ) -> float:
        """Norm of the errors of the unknowns c due to rounding of the terms of the elastic rows;
        factors as in `combine`."""


@dataclass(frozen=True, slots=True, eq=False)
class FullElastic(ElasticBlock):
    """Elastic block at full order: D factorized, one right-hand side per iteration. K is never
    multiplied."""

    ops: ElasticOperators
    factor: Factorized
    E: FloatArray
    G: FloatArray
    active: IntArray | None = None
    local: LocalForces | None = None

    @classmethod
    def of(cls, ops: ElasticOperators, factor: Factorized, block: str) -> "FullElastic":
        """Block with the columns E = D^-1 P. Raises SolveFailed, naming the block, where an
        iterative linear solver does not converge."""
        P = ops.directions
        E = solve_or_fail(factor, P, block) if P.size else P
        return cls(ops, factor, E, ops.directions.T @ E,
                   local=FullLocal(ops.local) if ops.local else None)

    @property
    def iterates(self) -> bool:
        return self.factor.iterative

    def begin(self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float) -> History:
        o, s = self.ops, History()
        Mr1, Mr2 = each(o.generators, r1), each(o.generators, r2)
        own = len(Mr2) and o.generators[0] is o.mass
        s.h = forces_of_history(o, Mr2[0] if own else o.mass @ r2, r1, xT, t)
        s.stack, s.quad = Mr1, np.concatenate([Mr1, Mr2])
        s.s1, s.s2 = o.directions.T @ r1, o.directions.T @ r2
        return s

    def functionals(self, c: FloatArray, history: History) -> Functionals:
        products = each(self.ops.generators, c)
        return Functionals(
            self.ops.directions.T @ c, products @ c, history.quad @ c, products)

    def combine(
        self, of: Functionals, history: History, factors: FloatArray, c: FloatArray,
        sigma: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        g = len(self.ops.generators)
        assert of.products is not None
        right = history.h + factors[:g] @ of.products + factors[g:-1] @ history.stack
        if history.local is not None:
            right = right + history.local.rows(c)
        if self.factor.iterative:
            z = self._iterated(right, -(c + self.E @ sigma), history)
        else:
            z = self.factor.solve(right)
        return z, self.ops.directions.T @ z

    def _iterated(self, right: FloatArray, guess: FloatArray, history: History) -> FloatArray:
        """Solution of an iterative linear solver; nan where it does not converge: the step then
        fails with the status in `history`."""
        found = self.factor.outcome(right, guess)
        history.iterations, history.residual = (
            history.iterations + found.iterations, found.residual)
        if found.status.ok:
            return found.x
        history.failure = found.status, unconverged_note(
            self.factor, found.residual, found.iterations)
        return np.full(len(right), np.nan)

    def update(self, z: FloatArray, sigma: FloatArray) -> FloatArray:
        return -(z + self.E @ sigma)

    def noise(
        self, c: FloatArray, history: History, factors: FloatArray, c1: float, c2: float
    ) -> float:
        return rounded(self.ops, self.factor, c, history, c1, c2)


@dataclass(frozen=True, slots=True, eq=False)
class CompressedElastic(ElasticBlock):
    """Reduced elastic block with s active atoms: all operators are dense and small (s + p rows, not
    n).

    Vectors are stacked as [z; P^T z], so that one product gives both. H, base: matrix (rows, k + k
    + kt + j) and constant part of the step's history for inputs r1, r2, temperatures and load
    amplitudes; S (rows, s): products with u. tables: tabulated (for example moving) loads,
    projected on s + p rows.
    """

    H: FloatArray
    base: FloatArray
    S: FloatArray
    E: FloatArray
    G: FloatArray
    active: IntArray | None
    amplitudes: tuple[Amplitude, ...]
    sizes: tuple[int, int, int]
    tables: tuple[Moving, ...] = ()
    local: LocalForces | None = None

    @classmethod
    def of(
        cls, b: TestedElastic, left: FloatArray, support: IntArray | None
    ) -> "CompressedElastic":
        """Reduced block from the tested operators; left (s, m): left inverse of the tested D on the
        support, left @ D_S = 1, as D^-1 in the tested rows."""
        k, p, g = b.mass.shape[1], b.functional.shape[0], len(b.generators)
        use = np.arange(k) if support is None else support
        s, kt, j = len(use), b.coupling.shape[1], b.loads.shape[1]
        F, w = b.functional[:, use], len(use) + p
        both = np.concatenate([left, F @ left])  # [D^-1; P^T D^-1] of tested rows
        gen = (both @ b.generators).reshape(g * w, k)
        quad = b.quadratic[:, use, :].reshape(g * s, k)
        rows = both @ np.hstack([
            b.damping, b.mass, -b.coupling, -b.loads, b.directions, b.constant[:, None]])
        # rows of the history: M_g r1 | h | u.M_g r1, u.M_g r2 | P^T r1, P^T r2
        sizes = (g * w, w, g * s, g * s, p, p)
        H, base = np.zeros((sum(sizes), 2 * k + kt + j)), np.zeros(sum(sizes))
        at = np.cumsum(sizes).tolist()
        H[: at[0], :k] = gen
        H[at[0] : at[1]] = rows[:, : H.shape[1]]
        base[at[0] : at[1]] = rows[:, -1]
        H[at[1] : at[2], :k] = H[at[2] : at[3], k : 2 * k] = quad
        H[at[3] : at[4], :k] = H[at[4] :, k : 2 * k] = b.functional
        S = np.concatenate([gen[:, use], F, quad[:, use]])
        E = rows[:, H.shape[1] : -1]
        return cls(H, base, S, np.ascontiguousarray(E[:s]), np.ascontiguousarray(E[s:]), support,
                   b.amplitudes, (s, p, g), tabulated(b.tables, both, support is None),
                   ReducedLocal.of(b.local, both))

    def rates(self, k: int) -> tuple[FloatArray, FloatArray]:
        s, p, g = self.sizes
        rows = self.H[g * (s + p) : g * (s + p) + s]
        return rows[:, :k], rows[:, k : 2 * k]

    def begin(self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float) -> History:
        parts = [r1, r2, xT]
        if self.amplitudes:
            parts.append(evaluate_amplitudes(self.amplitudes, t))
        s, p, g = self.sizes
        w, h = s + p, History()
        h.parts = np.concatenate(parts)
        out = self.H.dot(h.parts)
        out += self.base
        if self.tables:
            out[g * w : (g + 1) * w] -= total_load(self.tables, t)
        # rows kappa_g | mu_g | 1 of the combination; the first g are filled at each iterate
        h.stack = np.empty((2 * g + 1, w))
        h.stack[g:] = out[: (g + 1) * w].reshape(g + 1, w)
        a = (g + 1) * w
        h.quad = out[a : a + 2 * g * s].reshape(2 * g, s)
        a += 2 * g * s
        h.s1, h.s2 = out[a : a + p], out[a + p :]
        return h

    def functionals(self, c: FloatArray, history: History) -> Functionals:
        s, p, g = self.sizes
        out = self.S.dot(c)
        n = g * (s + p)
        history.stack[:g] = out[:n].reshape(g, s + p)
        form = out[n + p :].reshape(g, s).dot(c)
        return Functionals(out[n : n + p], form, history.quad.dot(c), None)

    def combine(
        self, of: Functionals, history: History, factors: FloatArray, c: FloatArray,
        sigma: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        z: FloatArray = factors.dot(history.stack)
        if history.local is not None:
            z = z + history.local.rows(c)
        s = self.sizes[0]
        return z[:s], z[s:]

    def update(self, z: FloatArray, sigma: FloatArray) -> FloatArray:
        new: FloatArray = -(z + self.E.dot(sigma))
        return new

    def noise(
        self, c: FloatArray, history: History, factors: FloatArray, c1: float, c2: float
    ) -> float:
        s, p, g = self.sizes
        w = s + p
        kappa, mu = np.abs(factors[:-1]).reshape(2, g)
        turned = (np.abs(self.S[: g * w]) @ np.abs(c)).reshape(g, w)
        past = (np.abs(self.H[: (g + 1) * w]) @ np.abs(history.parts)).reshape(g + 1, w)
        terms = kappa @ turned + mu @ past[:g] + past[g] + np.abs(self.base[g * w : (g + 1) * w])
        return EPS * float(np.linalg.norm(terms[:s]))


def rounded(
    ops: ElasticOperators, factor: Factorized, u: FloatArray, history: History, c1: float, c2: float
) -> float:
    """Norm of D^-1 e, with e of random signs and of the size of the round-off in the terms of D u,
    or of the residual of an iterative solver."""
    size, v = np.abs(u), rounding(len(u))
    terms = abs(ops.stiffness) @ size + c2 * (abs(ops.mass) @ size)
    if ops.damping.nnz:
        terms += c1 * (abs(ops.damping) @ size)
    terms += np.abs(history.h)
    if factor.iterative:
        left = history.residual * float(np.linalg.norm(history.h)) / np.sqrt(len(u))
        terms += left / EPS
    return float(np.linalg.norm(factor.solve(v * terms)))


def forces_of_history(
    ops: ElasticOperators, inertia: FloatArray, r1: FloatArray, xT: FloatArray, t: float
) -> FloatArray:
    """Terms (n,) that are constant in a step: M r2 (`inertia`) + D_m r1 less constant forces,
    thermal forces and loads at t, s."""
    h = inertia - ops.constant
    if ops.damping.nnz:
        h = h + ops.damping @ r1
    if ops.coupling is not None:
        h = h - ops.coupling @ xT
    return plus_loads(h, ops, t, -1.0)


def each(generators: Sequence[Csr], x: FloatArray) -> FloatArray:
    """Products M_g x (g, n)."""
    return np.stack([M @ x for M in generators]) if generators else np.zeros((0, len(x)))
