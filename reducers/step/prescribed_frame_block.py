"""Elastic block of a body whose frame motion is prescribed: linear, without coupling to rigid
unknowns.

With D = K + c1 D_m + c2 M constant (D_m: damping), its rows times D^-1 read

    u + sum_g kappa_g D^-1 M_g u = b,   b = -D^-1 (h + P sigma + sum_g mu_g M_g r1),

with h the terms of past states and loads, P the columns that couple to the frame, M_g constant
matrices. sigma, kappa and mu depend on time only (core/protocols/separable.py), so no moments and
quadratic forms of u are needed.
"""

from abc import abstractmethod
from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import numpy as np

from sparsemor.core import (
    Amplitude,
    ElasticOperators,
    Factorized,
    FloatArray,
    IntArray,
    unconverged_note,
)
from sparsemor.reducers.full.coarse_correction import CoarseCorrection
from sparsemor.reducers.projection.modal_coordinates import carried, dense, times
from sparsemor.reducers.step.acceptance import EPS, LEAST
from sparsemor.reducers.step.elastic_block import (
    DisplacementBlock,
    History,
    forces_of_history,
    rounded,
)
from sparsemor.reducers.step.elastic_local import FullLocal, LocalForces, ReducedLocal
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.time_tables import Moving, TimeTable, along, tabulated

LEADING = 64
"""Number of leading (soft) modes in which a second product per iteration is worthwhile."""


class Past(History):
    """Constants of one step, and its last iterate.

    kappa, mu (g,): factors of the frame's rotation, as lists; weights, rates: the same as arrays;
    c, u: last iterate (None at the start) and its image; r1: vector that mu multiplies, None when
    its product has been added; turning: range of the g in which kappa or mu is not zero; bound:
    upper bound of the contraction factor; terms: r1, r2 and temperatures of a reduced block's
    history, and the part of b that depends on time only.
    """

    __slots__ = ("bound", "c", "kappa", "mu", "r1", "rates", "terms", "turning", "u", "weights")

    def __init__(self, table: FloatArray, g: int, r1: FloatArray) -> None:
        super().__init__()
        self.kappa, self.mu = table[:g].tolist(), table[g : 2 * g].tolist()
        self.r1: FloatArray | None = r1
        self.c: FloatArray | None = None

    kappa: list[float]
    mu: list[float]
    u: FloatArray
    weights: FloatArray
    rates: FloatArray
    turning: tuple[int, int]
    bound: float
    terms: tuple[FloatArray, FloatArray, FloatArray, FloatArray]


class PrescribedBlock(DisplacementBlock):
    """Displacements on a frame whose motion is prescribed. proved: True if `contraction` is an
    upper bound in the Euclidean norm of the unknowns, False if it is an estimate."""

    proved: ClassVar[bool]

    @abstractmethod
    def time_table(self, drive: TimeTable) -> TimeTable:
        """Tabulated functions of time of a step: the frame's kappa, mu and sigma in `drive`, and
        others that depend on time only."""

    @abstractmethod
    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, table: FloatArray
    ) -> Past:
        """Constants of a step to t, s; xT: temperatures; table: values of `time_table` at t."""

    @abstractmethod
    def improve(self, c: FloatArray, past: Past) -> FloatArray:
        """One iteration: b - sum_g kappa_g D^-1 M_g c, followed by a correction in the lowest
        modes."""

    @abstractmethod
    def contraction(self, past: Past) -> float:
        """Bound or estimate of the factor by which `improve` reduces an error; 0.0 without
        rotation."""

    @abstractmethod
    def noise(self, c: FloatArray, past: Past, c1: float, c2: float) -> float:
        """Norm of the errors of the unknowns c due to rounding of the terms of the equations."""


@dataclass(frozen=True, slots=True, eq=False)
class FullPrescribed(PrescribedBlock):
    """Full order: D factorized, one right-hand side per iteration, and a coarse correction in the
    lowest modes. Its contraction factor is estimated by Ritz values, which are lower bounds of
    eigenvalues, times a safety factor."""

    proved: ClassVar[bool] = False
    ops: ElasticOperators
    factor: Factorized
    coarse: CoarseCorrection
    active: IntArray | None = None
    local: LocalForces | None = None

    @classmethod
    def of(cls, ops: ElasticOperators, factor: Factorized, block: str) -> "FullPrescribed":
        """Block with its coarse space. Raises SolveFailed, naming the block, where an iteration
        does not converge."""
        return cls(ops, factor, CoarseCorrection.of(ops, factor, block),
                   local=FullLocal(ops.local) if ops.local else None)

    @property
    def iterates(self) -> bool:
        return self.factor.iterative

    def time_table(self, drive: TimeTable) -> TimeTable:
        return drive

    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, table: FloatArray
    ) -> Past:
        o, g = self.ops, len(self.ops.generators)
        past = Past(table, g, r1)
        h = forces_of_history(o, o.mass @ r2, r1, xT, t)
        sigma = table[2 * g :]
        if sigma.any():
            h += o.directions @ sigma
        for M, mu in zip(o.generators, past.mu, strict=True):
            if mu:
                h += M @ (mu * r1)
        past.h = h
        return past

    def improve(self, c: FloatArray, past: Past) -> FloatArray:
        right = past.h if past.local is None else past.h + past.local.rows(c)
        for M, kappa in zip(self.ops.generators, past.kappa, strict=True):
            if kappa:
                right = right + M @ (kappa * c)
        if not self.factor.iterative:
            u = -self.factor.solve(right)
            return u + self.coarse.correction(u - c, past.kappa) if any(past.kappa) else u
        found = self.factor.outcome(right, -c)
        past.iterations, past.residual = past.iterations + found.iterations, found.residual
        if found.status.ok:
            return -found.x
        past.failure = found.status, unconverged_note(self.factor, found.residual, found.iterations)
        return np.full(len(right), np.nan)

    def contraction(self, past: Past) -> float:
        turning = self.coarse.left * sum(map(abs, past.kappa))
        return turning if self.local is None else max(turning, LEAST)

    def noise(self, c: FloatArray, past: Past, c1: float, c2: float) -> float:
        return rounded(self.ops, self.factor, c, past, c1, c2)


@dataclass(frozen=True, slots=True, eq=False)
class CompressedPrescribed(PrescribedBlock):
    """Reduced block with s active atoms: all operators are dense and small, independent of the
    mesh.

    Factors of b: inertia and damping times r2 and r1, (s, k) or diagonals, damping None where there
    is none; coupling (s, kt) times temperatures; base; E (s, p) times sigma; loads (s, j) times
    amplitudes, and tabulated loads. G (g, k, s): transposed D^-1 M_g, so that consecutive ones form
    one matrix; leading (g r, r): their first rows and columns, of soft modes, r = 0 where some
    atoms are not active; sizes (g, 3): Frobenius norms of each whole matrix, of its leading part,
    and of the rest.
    """

    proved: ClassVar[bool] = True
    inertia: FloatArray
    damping: FloatArray | None
    coupling: FloatArray
    base: FloatArray
    E: FloatArray
    loads: FloatArray
    G: FloatArray
    leading: FloatArray
    sizes: FloatArray
    active: IntArray | None
    amplitudes: tuple[Amplitude, ...]
    tables: tuple[Moving, ...] = ()
    local: LocalForces | None = None

    @classmethod
    def of(
        cls, b: TestedElastic, left: FloatArray, support: IntArray | None
    ) -> "CompressedPrescribed":
        """Reduced block from the tested operators; left (s, m): left inverse of the tested D on the
        support, left @ D_S = 1, as D^-1 in the tested rows."""
        G = np.stack([left @ A for A in b.generators]) if len(b.generators) else np.zeros(
            (0, len(left), b.mass.shape[1]))
        below = np.ascontiguousarray(G.transpose(0, 2, 1))
        r = min(LEADING, len(left)) if support is None else 0
        sizes = []
        for A in G if support is None else G[:, :, support]:
            all_of_it, lead = float(np.sum(A**2)), float(np.sum(A[:r, :r] ** 2))
            sizes.append((sqrt(all_of_it), sqrt(lead), _beyond(A, r)))
        return cls(
            carried(-left @ b.mass), carried(-left @ b.damping) if b.damping.any() else None,
            np.ascontiguousarray(left @ b.coupling), -left @ b.constant, -left @ b.directions,
            left @ b.loads, below, G[:, :r, :r].reshape(len(G) * r, r),
            np.array(sizes).reshape(len(G), 3), support,
            b.amplitudes, tabulated(b.tables, left, support is None),
            ReducedLocal.of(b.local, left))

    def rates(self, k: int) -> tuple[FloatArray, FloatArray]:
        none = np.zeros((len(self.base), k))
        return none if self.damping is None else -dense(self.damping), -dense(self.inertia)

    def time_table(self, drive: TimeTable) -> TimeTable:
        """kappa, mu, sigma, the bound of the contraction factor, and the part of b that depends on
        time only."""
        g, n = 2 * len(self.G), 2 * len(self.G) + self.E.shape[1]

        def decided(times: FloatArray) -> FloatArray:
            rows = np.empty((len(times), n + 1 + len(self.base)))
            rows[:, :n] = drive.along(times)
            rows[:, n] = self._bounds(rows[:, : len(self.G)])
            rows[:, n + 1 :] = along(rows[:, g:n].dot(self.E.T) + self.base, self.loads,
                                     self.amplitudes, self.tables, times)
            return rows

        # a support that may change with the next step does not pay for all times
        if self.active is not None:
            return TimeTable(decided)
        return TimeTable.of(decided, np.array(drive.times))

    def begin(
        self, r1: FloatArray, r2: FloatArray, xT: FloatArray, t: float, table: FloatArray
    ) -> Past:
        g = len(self.G)
        past, n = Past(table, g, r1), 2 * g + self.E.shape[1]
        past.weights, past.rates, past.bound = table[:g], table[g : 2 * g], float(table[n])
        acts = [i for i, k in enumerate(zip(past.kappa, past.mu, strict=True)) if any(k)]
        past.turning = (acts[0], acts[-1] + 1) if acts else (0, 0)
        past.terms = r1, r2, xT, table[n + 1 :]
        past.u = times(self.inertia, r2)
        past.u += table[n + 1 :]
        if self.damping is not None:
            past.u += times(self.damping, r1)
        if len(xT):
            past.u += self.coupling.dot(xT)
        return past

    def improve(self, c: FloatArray, past: Past) -> FloatArray:
        force = 0.0 if past.local is None else past.local.rows(self._wide(c))
        if not past.bound and not any(past.mu):  # nothing turns
            return past.u - force
        d = c if past.c is None else c - past.c  # only what is new is multiplied
        lo, hi = past.turning
        push = np.multiply.outer(past.weights[lo:hi], self._wide(d))
        if past.r1 is not None:
            push += np.multiply.outer(past.rates[lo:hi], past.r1)
        turned: FloatArray = push.ravel().dot(self.G[lo:hi].reshape(push.size, -1))
        u = past.u - turned
        past.c, past.u, past.r1 = c, u, None
        u = u - force
        r = self.leading.shape[1]
        if not r:
            return u
        new = u.copy()
        new[:r] -= past.weights.dot(self.leading.dot(u[:r] - c[:r])
                                      .reshape(len(self.G), r))
        return new

    def _bounds(self, kappa: FloatArray) -> FloatArray:
        """Bounds (T,) of the contraction factor for kappa (T, g): |E - L| + |L| |E| with E = sum_g
        kappa_g D^-1 M_g and its leading part L."""
        whole, lead, rest = np.abs(kappa).dot(self.sizes).T
        return np.asarray(rest + lead * whole)

    def _wide(self, d: FloatArray) -> FloatArray:
        """All unknowns, from the active ones."""
        if self.active is None:
            return d
        wide = np.zeros(self.G.shape[1])
        wide[self.active] = d
        return wide

    def contraction(self, past: Past) -> float:
        return past.bound if self.local is None else max(past.bound, LEAST)

    def noise(self, c: FloatArray, past: Past, c1: float, c2: float) -> float:
        r1, r2, xT, rest = map(np.abs, past.terms)
        size = times(np.abs(self.inertia), r2) + rest
        if self.damping is not None:
            size += times(np.abs(self.damping), r1)
        if len(xT):
            size += np.abs(self.coupling) @ xT
        if past.local is not None:
            size += np.abs(past.local.rows(self._wide(c)))
        if len(self.G):
            turned = np.multiply.outer(np.abs(past.weights), self._wide(np.abs(c)))
            turned += np.multiply.outer(np.abs(past.rates), r1)
            size += turned.ravel() @ np.abs(self.G).reshape(turned.size, -1)
        return EPS * float(np.linalg.norm(size))


def _beyond(A: FloatArray, r: int) -> float:
    """Frobenius norm of A (s, s) without its leading r rows and columns."""
    return sqrt(float(np.sum(A[r:] ** 2)) + float(np.sum(A[:r, r:] ** 2)))
