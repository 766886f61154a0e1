"""Mechanical equations of a step at full order, with the Schur complement of its displacements.

The rows of displacements are multiplied by the inverse of the body's constant operator
D = K + c1 C + c2 M, which is factorized once: for the departure d from the free motion u0, v0 of
the step (core/protocols/integrator.py)

    d + D^-1 (h + sum_g (kappa_g M_g u + mu_g M_g u') + P sigma + local terms) = 0,
    h = K u0 + C v0 - coupling T - loads,

with the factors kappa, mu, sigma of the body's frame. K is multiplied once a step; an iteration
takes one solution with D for each body. The Jacobian neglects kappa, mu and local terms in the rows
of displacements, so that these are eliminated by E = D^-1 P, and a system of the rigid coordinates
and joint forces alone is factorized (Schur complement). Where this does not contract, as for soft
bodies, a step needs the whole Jacobian (monolithic.py).
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from math import inf
from typing import NamedTuple, Self

import numpy as np
from scipy.sparse import vstack

from sparsemor.core import (
    Amplitude,
    Csr,
    Factorized,
    FloatArray,
    IntArray,
    Layout,
    StepFormula,
)
from sparsemor.core.model.factorizations import solve_or_fail, unconverged_note
from sparsemor.core.protocols.body_frame import FrameWork
from sparsemor.core.protocols.separable import (
    ElasticLocal,
    ElasticOperators,
    evaluate_amplitudes,
)
from sparsemor.reducers.linalg.coarse_correction import CoarseCorrection
from sparsemor.reducers.step.border_matrix import BorderMatrix
from sparsemor.reducers.step.convergence_test import LEAST, rounding
from sparsemor.reducers.step.frame_step import BodyStep, buffers
from sparsemor.reducers.step.jacobian_factors import Factor, IdentityFactor
from sparsemor.reducers.step.newton_loop import Linearisation, StepEquations
from sparsemor.reducers.step.time_tables import TimeTable, plus_loads

PRICE = 2
"""Cost of a new Jacobian in iterations."""
IN_SPACE = 1
"""The same in space, where the Jacobian changes with each step of a spin."""
UNCHANGED = 50
"""The same where no frame has unknowns: it is the identity."""

_NONE = np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False)
class FullBody:
    """A body at full order. ops, factor: its operators and the factorized D, None for a rigid body;
    G (g n, n): its matrices M_g, one below the other; E (n, p) = D^-1 P, compliance (p, p) = P^T E;
    noise (3, n): errors due
    to rounding K u, C u' and M u'' where these unknowns are 1. Of a body whose frame has no
    unknowns, `frame_factors`: kappa, mu and sigma as functions of time, and a coarse space for its
    rotation."""

    step: BodyStep
    ops: ElasticOperators | None = None
    factor: Factorized | None = None
    G: Csr | None = None
    E: FloatArray | None = None
    compliance: FloatArray | None = None
    noise: FloatArray | None = None
    frame_factors: TimeTable | None = None
    coarse: CoarseCorrection | None = None

    @classmethod
    def from_operators(
        cls, step: BodyStep, ops: ElasticOperators, factor: Factorized,
        frame_factors: TimeTable | None = None
    ) -> "FullBody":
        """Body with D^-1 P, and the effect of rounding: D^-1 of unit round-off with random signs
        times the row sums of |K|, |C| and |M|. Raises SolveFailed, naming the block, where a linear
        solver does not converge."""
        name, signs = step.elastic_name, rounding(len(ops.constant))
        terms = np.stack([signs * abs(A).sum(axis=1) for A in (
            ops.stiffness, ops.damping, ops.mass)], axis=1)
        noise = np.ascontiguousarray(solve_or_fail(factor, terms, name).T)
        G, P = vstack(ops.generators).tocsr() if ops.generators else None, ops.directions
        if frame_factors is not None:
            return cls(step, ops, factor, G, E=None, noise=noise, frame_factors=frame_factors,
                       coarse=CoarseCorrection.from_operators(ops, factor, name))
        E = solve_or_fail(factor, P, name) if P.size else P
        return cls(step, ops, factor, G, E, P.T @ E, noise)

    def inertia_products(self, u: FloatArray) -> FloatArray:
        """Products M_g u of displacements u (n,) or columns of them (n, m), (g, n) or (m, g, n)."""
        if self.G is None:
            return np.zeros((*u.shape[1:], 0, len(u)))
        products: FloatArray = (self.G @ u).T.reshape(*u.shape[1:], -1, len(u))
        return products


class Displaced:
    """An elastic body in a step: free motion u0, v0 (n,), its products with the g matrices M_g
    (2, g, n), and its terms h (n,) = K u0 + C v0 - coupling T - loads, on a prescribed frame with
    those of the frame; local: terms evaluated at each iterate; weights (g,) = kappa + c1 mu of a
    prescribed frame; known: D^-1 h of one that does not turn, without local terms."""

    __slots__ = ("h", "known", "local", "products", "u", "v", "weights")

    h: FloatArray
    known: FloatArray | None
    local: "LocalForces | None"
    products: FloatArray
    u: FloatArray
    v: FloatArray
    weights: FloatArray


class LocalForces:
    """Local terms of an elastic body in one step, such as nonlinear springs and stiffness that
    depends on temperature: forces (n,) as a function of the departure from the free motion u, v
    (n,), for final temperatures T with their rate. They are evaluated at each iterate, while the
    operator D stays constant."""

    def __init__(
        self, parts: Sequence[ElasticLocal], step: StepFormula, u: FloatArray, v: FloatArray,
        T: FloatArray, rate: FloatArray,
    ) -> None:
        self.step, self.u, self.v, self.T, self.rate = step, u, v, T, rate
        of_heat = [bool(part.hot.all()) for part in parts]
        self.iterated = [part for part, known in zip(parts, of_heat, strict=True) if not known]
        # terms that depend on temperatures alone are evaluated once
        self.known = self._sum([part for part, known in zip(parts, of_heat, strict=True) if known],
                               np.zeros(len(u)))

    def rows(self, d: FloatArray) -> FloatArray:
        """Forces (n,) at the departure d (n,)."""
        return self.known + self._sum(self.iterated, d)

    def _sum(self, parts: Sequence[ElasticLocal], d: FloatArray) -> FloatArray:
        """Forces (n,) of these terms at the departure d (n,) from the free motion u, v (n,); T,
        rate: final temperatures and their rate."""
        step, r = self.step, np.zeros(len(d))
        u, v, a = self.u + d, self.v + step.c1 * d, step.c2 * d
        for part in parts:
            # x, xv, xa: values that the term reads, displacements or (hot) temperatures, with rates
            hot, (x, xv, xa) = part.hot, np.zeros((3, len(part.columns)))
            of_u, of_T = part.columns[~hot], part.columns[hot]
            x[~hot], xv[~hot], xa[~hot] = u[of_u], v[of_u], a[of_u]
            x[hot], xv[hot] = self.T[of_T], self.rate[of_T]
            r[part.rows] += part.term.residual(x, xv, xa, step.t)
        return r


class Bordered(NamedTuple):
    """Jacobian of the mechanics at full order: entries of the Schur complement of the border
    (`BorderMatrix`), and for each elastic body its number, the numbers of its border unknowns, tau
    and sigma_y on these (m, p)."""

    schur: FloatArray
    bodies: list[tuple[int, IntArray, FloatArray, FloatArray]]


class BorderedFactor:
    """Factorization of a bordered Jacobian, by elimination of the displacements u: of the system
    u + E sigma_y^T y = r_u, tau P^T u + H y = r_y with E = D^-1 P (n, p), directions P, and border
    unknowns y (rigid coordinates and joint forces)."""

    def __init__(self, equations: "FullMechanics", J: Bordered) -> None:
        self.border, self.J, self.of = equations.border, J, equations.bodies
        assert equations.corner is not None
        self.factor = equations.corner.factorized(J.schur)

    def solve(self, r: FloatArray) -> FloatArray:
        """Solution for a right-hand side r (n,): Schur complement times y = r_y - tau P^T r_u, then
        u = r_u - E sigma_y^T y. J.bodies: number of the body, the border unknowns `at` (m,) that it
        uses, tau and sigma_y (m, p) on these."""
        z, y = r.copy(), r[self.border]
        for i, at, tau, _ in self.J.bodies:
            body = self.of[i]
            assert body.ops is not None
            y[at] -= tau.dot(body.ops.directions.T.dot(r[body.step.elastic]))
        z[self.border] = y = self.factor.solve(y)
        for i, at, _, sigma in self.J.bodies:
            body = self.of[i]
            assert body.E is not None
            z[body.step.elastic] -= body.E.dot(y[at].dot(sigma))
        return z


class FullMechanics(StepEquations):
    """Mechanical equations of a step at full order, for known temperatures.

    targets: prescribed values of constraints; border (N,): positions of rigid unknowns and joint
    forces. maps: of each body, which of the N border unknowns it uses (m,), their numbers in the
    model (m,), and their map (b, m) to its border. Of a step: X0, R (3, n) of the unknowns with
    their rates, X = X0 + R d; displaced: one `Displaced` for each body; needs_iteration: False
    where the residual is d plus constants; frames_at: x at which frames were last evaluated with
    derivatives.
    """

    named = ()
    frames_at: FloatArray = _NONE
    iterations: dict[str, int]

    def __init__(
        self, layout: Layout, bodies: Sequence[FullBody], targets: Sequence[tuple[int, Amplitude]],
        border: IntArray,
    ) -> None:
        """targets: (position in `border`, prescribed value) of constraints; border (N,): positions
        of rigid coordinates, then joint forces, in the layout."""
        self.layout, self.border = layout, border
        self.target_rows = border[[i for i, _ in targets]]
        self.target_values = [f for _, f in targets]
        self.bodies = [b for b in bodies if b.ops is not None or b.step.to_border.any()]
        # price: cost of a new Jacobian in iterations with the old one; in space 1, a new one each
        # step, but not with iterative linear solvers, which contract only to their tolerance
        moving = IN_SPACE if layout.quaternions and not self.iterates else PRICE
        self.price = moving if len(border) else UNCHANGED
        self.exact = self.iterates  # no whole Jacobian is factorized then, for which to give up
        moved = [b.step.to_border for b in self.bodies if b.frame_factors is None]
        self.corner = BorderMatrix(moved) if len(border) else None
        self.maps = []  # of each body: border unknowns that it uses, by their numbers in the border
        for b in self.bodies:  # and in the layout, and the map to its own border from these
            used = np.flatnonzero(b.step.to_border.any(axis=0))
            self.maps.append((used, border[used], b.step.to_border[:, used]))
        self.work = buffers([b.step.frame for b in self.bodies])

    def working(self, memory: object = None) -> Self:
        own = copy(self)
        own.work = buffers([b.step.frame for b in self.bodies])
        return own

    @property
    def iterates(self) -> bool:
        """True if any body has an iterative linear solver."""
        return any(b.factor is not None and b.factor.iterative for b in self.bodies)

    def begin(self, step: StepFormula, d: FloatArray) -> None:
        """Takes over the constants of a step; d (n,): its first guess, with final temperatures."""
        self.frames_at = _NONE
        self.step, self.X0 = step, np.stack([step.free, step.free_rate, np.zeros(len(d))])
        layout, self.R = self.layout, np.zeros((3, len(d)))
        self.R[0], self.R[1, layout.second], self.R[2, layout.second] = 1.0, step.c1, step.c2
        self.iterations, self.failed = {}, None
        self.least, self.needs_iteration = LEAST, bool(len(self.border))
        self.displaced = [self._constant_part(b, d, w) for b, w in zip(
            self.bodies, self.work, strict=True)]

    def _constant_part(self, b: FullBody, d: FloatArray, work: FrameWork) -> Displaced:
        """One body's rows at zero departure of its displacements, as far as they stay during the
        step; on a prescribed frame that does not turn, without local terms, they give the solution.

        d (n,): departures, of which temperatures are final; work: arrays of the body's frame, which
        take its factors if its motion is prescribed."""
        one, o, step, at = Displaced(), b.ops, self.step, b.step.elastic
        if o is None:
            return one
        one.u, one.v, one.local, one.known = step.free[at], step.free_rate[at], None, None
        T = step.free[b.step.thermal] + d[b.step.thermal]
        h = o.stiffness @ one.u - o.constant
        if o.damping.nnz:
            h += o.damping @ one.v
        if o.coupling is not None:
            h -= o.coupling @ T
        one.h = plus_loads(h, o, step.t, -1.0)
        if o.local or o.damps:  # damps: damping that is no sparse matrix
            rate = step.free_rate[b.step.thermal] + step.c1_first * d[b.step.thermal]
            one.local = LocalForces((*o.local, *o.damps), step, one.u, one.v, T, rate)
        if b.frame_factors is None:
            one.products = b.inertia_products(np.stack([one.u, one.v], axis=1))
            return one
        # prescribed frame: table = [kappa, mu, sigma]
        g, table = len(o.generators), b.frame_factors.at(step.t)
        work.coefficients[: 2 * g], work.sigma[-1] = table[: 2 * g], table[2 * g :]
        kappa, mu = table[:g], table[g : 2 * g]
        one.weights = kappa + step.c1 * mu
        if work.sigma[-1].any():
            one.h = one.h + o.directions @ work.sigma[-1]
        if kappa.any() or mu.any():
            past = b.inertia_products(np.stack([one.u, one.v], axis=1))
            one.h = one.h + kappa @ past[0] + mu @ past[1]
        if not one.weights.any() and one.local is None:
            one.known = self._operator_solution(b, one.h, d[at], one)
            return one
        self.needs_iteration = True
        if b.coarse is not None:  # least: lower bound of the ratio of two changes of the iteration
            self.least = max(self.least, b.coarse.contraction * float(np.abs(one.weights).sum()))
        return one

    def residual(self, d: FloatArray, slope: bool = False) -> FloatArray:
        """Residual of the border rows, and of displacements already multiplied by the inverse of
        their constant operators: r = d + D^-1 (...). displaced: terms of each body that stay during
        the step (`_constant_part`); maps: of each body the numbers `at` of the border unknowns that
        it uses, and their map to its border. X0, R (3, n): x, v, a = X0 + R d; frames_at: x at
        which frames were last evaluated, with derivatives, which `jacobian` then need not do
        again."""
        r, X = d.copy(), self.X0 + self.R * d
        r[self.layout.first] = 0.0  # temperatures are known
        r[self.border] = 0.0
        if self.target_values:
            r[self.target_rows] -= evaluate_amplitudes(self.target_values, self.step.t)
        # w.border: derivatives, and the rows in the last column; w.sigma: the factors of the
        # directions P in the last row; derivatives cost little next to a solution with D
        rates, self.frames_at = (self.step.c1, self.step.c2), X[0]
        for b, w, one, (_, at, to_border) in zip(
                self.bodies, self.work, self.displaced, self.maps, strict=True):
            own = d[b.step.elastic]
            if b.frame_factors is None:  # border rows, and factors at this iterate
                products = self._evaluate(b, one, own, X, self.step.t, w, at, to_border, rates)
                r[at] += w.border[:, -1] @ to_border
            if b.ops is None:
                continue
            if one.known is not None:
                r[b.step.elastic] = own + one.known
                continue
            # right: h + sum_g (kappa_g M_g u + mu_g M_g u') + P sigma + local terms
            right = one.h if one.local is None else one.h + one.local.rows(own)
            if b.frame_factors is None:
                right = right + w.coefficients[:-1] @ products
                if w.sigma.shape[1]:
                    right += b.ops.directions @ w.sigma[-1]
            elif one.weights.any():
                right = right + one.weights @ b.inertia_products(own)
            change = own + self._operator_solution(b, right, own, one)
            # the equation is satisfied in its softest modes, where the change decays most slowly
            if b.coarse is not None and b.coarse.Z.size and one.weights.any():
                change += b.coarse.correction(change, one.weights.tolist())
            r[b.step.elastic] = change
        return r

    def _evaluate(
        self, b: FullBody, one: Displaced | None, d: FloatArray, X: FloatArray, t: float,
        work: FrameWork, at: IntArray, to_border: FloatArray,
        rates: tuple[float, float] | None,
    ) -> FloatArray:
        """Evaluates a frame at unknowns with rates X (3, n) at t, s, with derivatives for dv = c1
        dx, da = c2 dx if c1, c2 are given; returns M_g u, then M_g u' (2 g, n). at, to_border: the
        rigid unknowns and joint forces that it reads, and their map to its border. one: the
        products of the free motion, to which those of the departure d (n,) are added; None for
        products anew."""
        y = X[:, at] @ to_border.T
        y[0] += b.step.origin
        if b.step.guide is not None:
            for row, part in zip(y, b.step.guide.at(t), strict=True):
                row[: len(part)] += part
        U, o = X[:, b.step.elastic], b.ops
        if o is None:
            s, forms, products = np.zeros((3, 0)), np.zeros(0), np.zeros((0, 0))
        else:
            # products (3, g, n): M_g u, M_g u', M_g u''
            if one is None:
                products = b.inertia_products(np.ascontiguousarray(U.T))
            else:  # one product M_g d serves all rates: u = u0 + d, u' = v0 + c1 d, u'' = c2 d
                products = np.empty((3, *one.products.shape[1:]))
                products[2] = b.inertia_products(d)
                np.add(one.products[0], products[2], out=products[0])
                np.multiply(products[2], self.step.c1, out=products[1])
                products[1] += one.products[1]
                products[2] *= self.step.c2
            s, forms = U @ o.directions, (products @ U[0]).ravel()
            products = products[:2].reshape(-1, U.shape[1])
        work.fresh = rates is not None  # with derivatives
        c1, c2 = rates or (0.0, 0.0)
        b.step.frame.evaluate(y[0], y[1], y[2], c1, c2, s, forms, t, work)
        return products

    def _operator_solution(
        self, b: FullBody, right: FloatArray, d: FloatArray, one: Displaced
    ) -> FloatArray:
        """D^-1 right (n,); d (n,): departure, whose negative is the first guess of an iterative
        linear solver. The tolerance of one is relative to the right-hand side of the whole
        displacements: that of a departure may be round-off. Not a number where it does not
        converge."""
        o, factor, step = b.ops, b.factor, self.step
        assert o is not None and factor is not None
        if not factor.iterative:
            return factor.solve(right)
        # D (-d - u0) = right - D u0, for the displacements themselves
        u = one.u
        whole = right - o.stiffness @ u - step.c1 * (o.damping @ u) - step.c2 * (o.mass @ u)
        found = factor.outcome(whole, -d - u)
        name = b.step.elastic_name
        self.iterations[name] = self.iterations.get(name, 0) + found.iterations
        if found.status.ok:
            return np.asarray(found.x + u)
        self.failed = name, found.status, unconverged_note(
            factor, found.residual, found.iterations)
        return np.full(len(right), np.nan)

    def jacobian(self, at: Linearisation) -> Bordered | None:
        """Jacobian at a state, without kappa, mu and local terms in the rows of displacements; of
        each body its border corner H - tau P^T E sigma_y^T, with E = D^-1 P. None for the
        identity."""
        if self.corner is None:
            return None
        X, parts, corners = np.stack([at.x, at.v, at.a]), [], []
        # evaluated with the residual
        known = len(self.frames_at) == len(at.x) and bool((at.x == self.frames_at).all())
        for i, (b, w, (used, columns, to_border)) in enumerate(zip(
                self.bodies, self.work, self.maps, strict=True)):
            if b.frame_factors is not None:
                continue
            if not known:
                self._evaluate(b, one=None, d=_NONE, X=X, t=at.t, work=w, at=columns,
                               to_border=to_border, rates=at.c[:2])
            # last column of w.border: the rows; last row of w.sigma: factors, not derivatives
            H = w.border[:, :-1]
            if b.compliance is not None:
                parts.append((i, used, to_border.T @ w.tau, to_border.T @ w.sigma[:-1]))
                H = H - w.tau @ b.compliance @ w.sigma[:-1].T
            corners.append(H.ravel())
        return Bordered(self.corner.assembled(np.concatenate(corners)), parts)

    def contraction(self, point: Linearisation) -> float:
        return inf if self.needs_iteration else 0.0

    def factorize(self, J: Bordered | None) -> Factor:
        return IdentityFactor() if J is None else BorderedFactor(self, J)

    def magnitudes(self, J: Bordered | None, x: FloatArray) -> FloatArray:
        """Magnitudes (n,) of the terms: |x|, and of the border in its Schur complement."""
        sizes = np.abs(x)
        if J is not None and self.corner is not None:
            sizes[self.border] = self.corner.magnitudes(J.schur, sizes[self.border])
        return sizes

    def rounding(self, J: Bordered | None, at: Linearisation) -> FloatArray:
        """Round-off of each unknown: of the border by the magnitudes in its Schur complement, of
        displacements by the noise (3, n) of their solver at unit u, u' and u'', times the largest
        of these."""
        found = np.zeros(len(at.x))
        if J is not None:
            sizes, fixed = self.magnitudes(J, at.x), self.layout.algebraic
            sizes[fixed] = np.maximum(sizes[fixed], 1.0)
            found[self.border] = (rounding(len(sizes)) * sizes)[self.border]
        for b in self.bodies:
            if b.noise is not None:
                e = b.step.elastic
                found[e] = [float(np.abs(z[e]).max()) for z in (at.x, at.v, at.a)] @ b.noise
        return found

