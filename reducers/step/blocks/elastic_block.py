"""Elastic block of one body inside a step, with its elimination from the bordered Newton system.

The unknown is the increment d of the displacements from a prediction: u = u0 + d, u' = v0 + c1 d,
u'' = a0 + c2 d. With D = K + c1 D_m + c2 M constant (D_m: damping), the elastic rows times D^-1
read

    d + z + E sigma = 0,   z = D^-1 (h + sum_g kappa_g M_g u + mu_g M_g u'),   E = D^-1 P,

with h = M a0 + D_m v0 + K u0 less loads, P the columns that couple to the frame ("directions"), M_g
constant matrices, and the scalars sigma, kappa, mu of the frame's motion. Increments keep the
digits of accelerations: c2 is 1/(beta h^2) (Bottasso, Bauchau and Cardona 2007, doi
10.1137/050638503). Full order solves with the factorized D; a reduced block has D^-1 applied to all
matrices in advance. The iteration is the same for both.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core import Csr, Factorized, FloatArray, IntArray, Status
from sparsemor.core.model.factorizations import solve_or_fail, unconverged_note
from sparsemor.core.protocols import ElasticOperators, FrameWork
from sparsemor.reducers.step.acceptance import EPS, rounding
from sparsemor.reducers.step.blocks.elastic_local import FullLocal, LocalForces, StepForces
from sparsemor.reducers.step.predictor import Prediction
from sparsemor.reducers.step.time_tables import plus_loads


class History:
    """One elastic block in a step: constants from its prediction, and terms at the last iterate.

    at: the prediction; u (s,): predicted displacements of the active unknowns; h: terms of the
    prediction and loads; products: of the prediction and its rates with M_g and P; local: local
    terms, None where there are none. Of an iterative linear solver: its number of iterations in
    this step, the norm of its residual, and status and message of a solve that did not converge.

    At the increment d: s (3, p) = P^T (u, u', u''); forms (3 g,) = u.M_g (u, u', u''); stack: rows
    M_g u, then M_g u', and if reduced times D^-1, and h + P^T d as the last row; terms: what
    one method leaves for the next.
    """

    __slots__ = ("at", "c1", "c2", "failure", "forms", "h", "iterations", "local", "products",
                 "residual", "s", "stack", "terms", "u")

    def __init__(self, at: Prediction, c1: float, c2: float) -> None:
        self.at, self.c1, self.c2 = at, c1, c2
        self.iterations, self.residual = 0, 0.0
        self.local: StepForces | None = None
        self.failure: tuple[Status, str] | None = None

    forms: FloatArray
    h: FloatArray
    products: FloatArray
    s: FloatArray
    stack: FloatArray
    terms: tuple[FloatArray, ...]
    u: FloatArray


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
        to the history terms r1 and r2 of the step formula; None at full order."""
        return None


class ElasticBlock(DisplacementBlock):
    """Displacements of a body whose frame has unknowns."""

    @abstractmethod
    def begin(self, at: Prediction, c1: float, c2: float) -> History:
        """A step from the prediction, at d = 0."""

    @abstractmethod
    def move(self, d: FloatArray, history: History) -> None:
        """Products of the displacements with P and M_g at the increment d (s,)."""

    @abstractmethod
    def condensed(self, d: FloatArray, history: History, work: FrameWork) -> FloatArray:
        """P^T times the elastic rows and their derivatives by the border unknowns, with the frame
        evaluated at d: (p, b + 1), columns P^T E sigma_y, then P^T (d + z + E sigma)."""

    @abstractmethod
    def increment(self, history: History, dy: FloatArray) -> FloatArray:
        """Increment -(z + E sigma) of the block (s,), for border unknowns (b,) less dy than those
        of `condensed`."""

    @abstractmethod
    def response(self, sigma: FloatArray) -> FloatArray:
        """Displacements E sigma (s,) due to factors sigma (p,) of the frame directions."""

    @abstractmethod
    def noise(self, d: FloatArray, history: History, factors: FloatArray) -> float:
        """Norm of the errors of the increment d due to rounding of the terms of the elastic rows;
        factors (2 g + 1,) = [kappa, mu, 1]."""


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

    def begin(self, at: Prediction, c1: float, c2: float) -> History:
        o, s = self.ops, History(at, c1, c2)
        values = np.stack([at.x, at.v, at.a])
        s.u, columns = at.x, np.ascontiguousarray(values.T)
        s.products = np.empty((3, len(o.generators), len(at.x)))
        for i, M in enumerate(o.generators):
            s.products[:, i] = (M @ columns).T
        own = len(o.generators) and o.generators[0] is o.mass
        s.h = predicted_forces(o, s.products[2, 0] if own else o.mass @ at.a, at)
        s.s = values @ o.directions
        s.terms = (np.zeros(s.s.shape[1]),)
        s.stack, s.forms = s.products[:2].reshape(-1, len(at.x)), (s.products @ at.x).ravel()
        return s

    def move(self, d: FloatArray, history: History) -> None:
        rates = np.array([1.0, history.c1, history.c2])[:, None]
        products, past, at = each(self.ops.generators, d), history.products, history.at
        u, g = history.u + d, len(products)
        history.stack = np.empty((2 * g, len(d)))
        np.add(past[0], products, out=history.stack[:g])
        np.multiply(products, history.c1, out=history.stack[g:])
        history.stack[g:] += past[1]
        forms = past @ u + rates * (products @ u)
        history.forms, Pd = forms.ravel(), self.ops.directions.T @ d
        history.s = np.stack([at.x, at.v, at.a]) @ self.ops.directions + rates * Pd
        history.terms = (Pd,)

    def condensed(self, d: FloatArray, history: History, work: FrameWork) -> FloatArray:
        right = history.h + work.coefficients[:-1] @ history.stack
        if history.local is not None:
            right = right + history.local.rows(d)
        if self.factor.iterative:
            z = self._iterated(right, -(d + self.E @ work.sigma[-1]), history)
        else:
            z = self.factor.solve(right)
        rows = self.G @ work.sigma.T
        rows[:, -1] += history.terms[0] + self.ops.directions.T @ z
        history.terms = z, work.sigma
        return rows

    def _iterated(self, right: FloatArray, guess: FloatArray, history: History) -> FloatArray:
        """Solution of an iterative linear solver; nan where it does not converge: the step then
        fails with the status in `history`."""
        return solved_by_iteration(self.ops, self.factor, right, guess, history)

    def increment(self, history: History, dy: FloatArray) -> FloatArray:
        z, sigma = history.terms
        return np.asarray(-(z + self.E @ (sigma[-1] - dy @ sigma[:-1])))

    def response(self, sigma: FloatArray) -> FloatArray:
        return self.E @ sigma

    def noise(self, d: FloatArray, history: History, factors: FloatArray) -> float:
        return rounded(self.ops, self.factor, d, history)


def solved_by_iteration(
    ops: ElasticOperators, factor: Factorized, right: FloatArray, guess: FloatArray,
    history: History
) -> FloatArray:
    """Solution z of D z = right by an iterative linear solver, nan where it does not converge. Its
    tolerance is relative to the right-hand side of the whole displacements, D (z - u0) = right - D
    u0: that of an increment may be round-off."""
    u = history.u
    whole = right - ops.stiffness @ u - history.c1 * (ops.damping @ u) - history.c2 * (ops.mass @ u)
    found = factor.outcome(whole, guess - u)
    history.iterations += found.iterations
    history.residual = found.residual * float(np.linalg.norm(whole))
    if found.status.ok:
        return np.asarray(found.x + u)
    history.failure = found.status, unconverged_note(factor, found.residual, found.iterations)
    return np.full(len(right), np.nan)


def rounded(
    ops: ElasticOperators, factor: Factorized, d: FloatArray, history: History
) -> float:
    """Norm of D^-1 e, with e of random signs and of the size of the round-off in the terms of the
    elastic rows, or of the residual of an iterative solver."""
    at, v = history.at, rounding(len(d))
    terms = abs(ops.stiffness) @ np.abs(at.x) + abs(ops.mass) @ np.abs(at.a)
    if ops.damping.nnz:
        terms += abs(ops.damping) @ np.abs(at.v)
    terms += np.abs(history.h)
    if factor.iterative:
        terms += history.residual / np.sqrt(len(d)) / EPS
    return float(np.linalg.norm(factor.solve(v * terms)))


def predicted_forces(ops: ElasticOperators, inertia: FloatArray, at: Prediction) -> FloatArray:
    """Terms (n,) of a prediction: M a0 (`inertia`) + D_m v0 + K u0 less constant forces, thermal
    forces and loads."""
    h = inertia - ops.constant + ops.stiffness @ at.x
    if ops.damping.nnz:
        h = h + ops.damping @ at.v
    if ops.coupling is not None:
        h = h - ops.coupling @ at.T
    return plus_loads(h, ops, at.t, -1.0)


def each(generators: Sequence[Csr], x: FloatArray) -> FloatArray:
    """Products M_g x (g, n)."""
    return np.stack([M @ x for M in generators]) if generators else np.zeros((0, len(x)))
