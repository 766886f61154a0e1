"""Displacements on a frame whose motion is prescribed: the rows of a step are linear in them,

    d + base(t) + sum_g (kappa_g G_g u + mu_g G_g u'),    base = E sigma + constant terms - loads,

with factors kappa, mu and sigma that depend on time alone (core/protocols/body_frame.py), and the
departure d from the free motion of the step. The *rotation* is the sum over g: inertia forces in
the turning frame. Rows are times the inverse of the block's own operator, so that the Jacobian is

    J = 1 + sum_g w_g G_g,     w_g = kappa_g + c1 mu_g,

near the identity for small steps; only its part in the leading (soft) modes is factorized.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from math import hypot, inf
from typing import Self

import numpy as np

from sparsemor.core import FloatArray, IntArray, StepFormula
from sparsemor.core.protocols.load_tables import times_rows
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.newton_loop import Linearisation
from sparsemor.reducers.step.projected_operators import ProjectedElastic
from sparsemor.reducers.step.time_tables import TimeTable, along

LEADING = 64
"""Number of leading (soft) modes in which the Jacobian differs from the identity."""
SMALL = 0.5
"""Largest norm of J - 1 for which the norm of J^-1 is bounded."""


@dataclass(frozen=True, slots=True, eq=False)
class RowsInTime:
    """Functions of time of the rows of `operators`: [kappa, mu, base] (T, 2 g + k), with `factors`
    for [kappa, mu, sigma] (T, 2 g + p), and base = directions sigma + constant - loads(t)."""

    operators: ProjectedElastic
    factors: TimeTable

    def __call__(self, times: FloatArray) -> FloatArray:
        t, factors = self.operators, self.factors.along(times)
        n = 2 * len(t.generators)
        base = times_rows(factors[:, n:], t.directions) + t.constant
        return np.hstack((factors[:, :n], base - along(
            np.zeros(len(t.constant)), t.loads, t.amplitudes, t.tables, times)))


class PrescribedBody:
    """Rows of one body with prescribed motion, but for the term d; rows: their numbers; factors:
    kappa, mu and sigma as functions of time; table: `RowsInTime`, if it is known. at: numbers of
    its displacements; generators (g, l, k), and G (g, k, l) the same transposed.

    leading: number of unknowns in which the Jacobian differs from the identity; acting: range of
    the matrices whose factors are not zero at all times. Of a step: weights (g,) = kappa + c1 mu,
    the range `turning` of the matrices in use, empty at rest, and its first guess. Of
    the last Jacobian that `contraction` was evaluated for: its point, its weights (`before`), and
    the norm `size` of J - 1.
    """

    def __init__(
        self, step: BodyStep, operators: ProjectedElastic, factors: TimeTable, rows: slice,
        table: TimeTable | None = None,
    ) -> None:
        """step: the body, with the range of its displacements; operators: its operators times the
        left inverse of its own; factors: [kappa, mu, sigma] (T, 2 g + p); rows: range of its rows
        in the model; table: [kappa, mu, base] (T, 2 g + k), if it is known already. leading: number
        of leading (soft) modes in which the Jacobian differs from the identity."""
        self.step, self.at, self.rows = step, step.elastic, rows
        self.generators, k = operators.generators, operators.mass.shape[1]
        self.G = np.ascontiguousarray(operators.generators.transpose(0, 2, 1))
        self.leading = r = min(LEADING, k) if len(self.G) else 0
        # Frobenius norms of the leading part of each matrix and of its rest
        self.sizes = np.zeros((len(self.G), 2))
        for i, A in enumerate(operators.generators):
            below, right = float(np.linalg.norm(A[r:])), float(np.linalg.norm(A[:r, r:]))
            self.sizes[i] = np.linalg.norm(A[:r, :r]), hypot(below, right)
        self.table = table or TimeTable.tabulate(
            RowsInTime(operators, factors), np.array(factors.times))
        self.acting = slice(0, len(self.G))
        if self.table.rows is not None:  # kappa and mu are known at all times
            known = self.table.rows[:, : 2 * len(self.G)].any(axis=0)
            acts = np.flatnonzero(known.reshape(2, -1).any(axis=0))
            self.acting = slice(acts[0], acts[-1] + 1) if len(acts) else slice(0, 0)

    weights: FloatArray
    guess: FloatArray
    turning: slice
    point: Linearisation | None = None
    before: FloatArray
    size: float

    def working(self) -> Self:
        """These rows with the constants of a step of their own."""
        return copy(self)

    def of_rows(self, rows: IntArray | None) -> TimeTable:
        """The table for the rows with these numbers alone, None for all."""
        return self.table if rows is None else self.table.columns(
            np.concatenate((np.arange(2 * len(self.G)), 2 * len(self.G) + rows)))

    def base(self, t: float) -> FloatArray:
        """The part (k,) of the rows that depends on time (s) alone."""
        return self.table.at(t)[2 * len(self.G) :]

    def begin(self, step: StepFormula, d: FloatArray, r: FloatArray) -> None:
        """Takes over the constants of a step; adds the terms of time alone, and the rotation at the
        first guess d (n,) of the departure, to r. The rotation is sum_g G_g (kappa_g u + mu_g u'),
        with u = free + d and u' = free_rate + c1 d: inertia forces due to the frame's motion; d is
        the departure of the unknowns from those without forces in this step. acting: range of the g
        whose factors are nonzero at any time; turning: the same, or empty in a step at rest.
        guess: this d, from which `residual` later takes its change (unused at rest). weights (g,) =
        kappa + c1 mu: factors of G_g in the derivative by d."""
        g, at, table = len(self.G), self.at, self.table.at(step.t)  # [kappa, mu, base]
        r[self.rows] += table[2 * g :]
        factors, some = table[: 2 * g].reshape(2, g), self.acting
        kappa, mu = factors
        self.turning = slice(0, 0)
        if some.stop == some.start or not factors.any():  # at rest
            self.weights = kappa
            return
        self.turning = some
        self.weights, self.guess, own = kappa + step.c1 * mu, d, d[at]
        inertia = np.multiply.outer(kappa[some], step.free[at] + own)
        inertia += np.multiply.outer(mu[some], step.free_rate[at] + step.c1 * own)
        self._add(r, inertia)

    def add(self, r: FloatArray, d: FloatArray) -> None:
        """Adds the rotation at the departure d (n,) to r, which holds that at the guess."""
        if self.turning.stop and d is not self.guess:
            own = d[self.at] - self.guess[self.at]
            self._add(r, np.multiply.outer(self.weights[self.turning], own))

    def _add(self, r: FloatArray, inertia: FloatArray) -> None:
        """Adds sum_g G_g w_g to r, with the vectors w_g (`inertia`) of the g in `turning`."""
        stacked = self.G[self.turning].reshape(inertia.size, self.G.shape[2])
        r[self.rows] += inertia.ravel().dot(stacked)

    def rotation(self, x: FloatArray, v: FloatArray, t: float) -> FloatArray:
        """Rows (k,) of the rotation at any unknowns x with rates v, (n,) each, at t, s."""
        g, table = len(self.G), self.table.at(t)
        inertia = np.multiply.outer(table[:g], x[self.at])
        inertia += np.multiply.outer(table[g : 2 * g], v[self.at])
        return np.asarray(inertia.ravel().dot(self.G.reshape(inertia.size, self.G.shape[2])))

    def slope(self, t: float, c1: float, size: int | None = None) -> FloatArray:
        """Jacobian of the rotation for dv = c1 dx, in the first `size` unknowns or in all."""
        some = slice(size)
        return np.tensordot(self._weights(t, c1), self.generators[:, some, some], 1)

    def contraction(self, point: Linearisation, sizes: FloatArray | None = None) -> float:
        """Proved upper bound, in the Euclidean norm, of the ratio of two changes of this step with
        the Jacobian at a point: |J^-1| |J - dF/dd|; inf where none is known. J = 1 + sum_g w_g G_g
        in the leading modes, with the weights w there (`before`), dF/dd with those of this step in
        all modes. sizes (g, 2): norms of the leading part of each matrix and of its rest, of those
        with which the iteration is made, if not G_g."""
        return float(self._bound(
            point, self.weights, self.sizes if sizes is None else sizes, np.dot))

    def contraction_along(self, point: Linearisation, times: FloatArray) -> FloatArray:
        """`contraction` (T,) of the steps that end at times (T,), s, each to the last bit the same
        whichever the others are."""
        g, c1, rows = len(self.G), point.c[0], self.table.along(times)
        return self._bound(
            point, rows[:, :g] + c1 * rows[:, g : 2 * g], self.sizes,
            lambda table, norms: times_rows(table, norms[None])[:, 0])

    def _bound(
        self, point: Linearisation, weights: FloatArray, sizes: FloatArray,
        product: Callable[[FloatArray, FloatArray], FloatArray],
    ) -> FloatArray:
        """Bound of the contraction of a step with these weights (g,), or of each of several (T, g),
        with the Jacobian at a point; product: of weights with norms (g,)."""
        if point is not self.point:
            self.before = self._weights(point.t, point.c[0])
            self.point, self.size = point, float(np.abs(self.before).dot(sizes[:, 0]))
        if not self.size and not weights.any():
            return np.zeros(weights.shape[:-1])
        # |J^-1| <= 1 / (1 - |J - 1|); dF/dd differs from J by the weights, and outside the leading
        # modes by all of the rotation
        off = product(np.abs(weights - self.before), sizes[:, 0])
        off = off + product(np.abs(weights), sizes[:, 1])
        return np.asarray(off / (1.0 - self.size) if self.size < SMALL else off + inf)

    def _weights(self, t: float, c1: float) -> FloatArray:
        """Weights (g,) = kappa + c1 mu at t, s."""
        g, table = len(self.G), self.table.at(t)
        return np.asarray(table[:g] + c1 * table[g : 2 * g])
