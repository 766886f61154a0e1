"""Equations of motion of a body in a floating frame of reference, row by row.

Residual, with inputs y = Y x (rigid coordinates and attachment forces) and linear functionals s = D
x of the displacements x:

    r = L rows(y, s, ...) + W sigma + sum_g (kappa_g V_g x + mu_g V_g v) + V_m a

The matrices are sparse at full order, small and dense after projection on a trial and a test basis.
One class evaluates both: projected residual == left @ residual.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.sparse import csr_array, issparse

from sparsemor.core.arrays import Csr, FloatArray, IntArray, Matrix
from sparsemor.core.model.equations import AssembledTerm, dense
from sparsemor.core.protocols.body_frame import Frame, FrameWork
from sparsemor.core.protocols.contributions import BodyRecord, FrameRecord
from sparsemor.core.protocols.layout import Layout, Quantity
from sparsemor.core.protocols.prescribed_motion import FrameHistory
from sparsemor.core.protocols.separable import MovingBody
from sparsemor.core.protocols.term import ReducedTerm, Trial

SMALL = 256
"""Unknowns of a term up to which its Jacobian is computed with dense matrices: each sparse matrix
takes longer to make than so small products take."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameEquations(ReducedTerm):
    """Residual r with m rows and n unknowns x; b inputs y = Y x + y0 (rigid coordinates, attachment
    forces), p functionals s = D x of directions, g generators (constant matrices whose factors
    kappa, mu depend on the rigid motion):

        r = L rows(y, s, ...) + W sigma + sum_g (kappa_g V_g x + mu_g V_g v) + V_m a

    Y (b, n), D (p, n), Q: g matrices (n, n) of the quadratic forms, L (m, b), W (m, p), V: g
    matrices (m, n), the first is the mass if `inert`; y0 (b,): constant part of y. guide: a
    prescribed motion of the frame, which is added to y = Y x + y0 and its rates.
    """

    frame: Frame
    Y: Matrix
    y0: FloatArray
    D: Matrix
    Q: tuple[Matrix, ...]
    L: Matrix
    W: Matrix
    V: tuple[Matrix, ...]
    guide: FrameHistory | None = None
    inert: bool = True
    linear: ClassVar[bool] = False

    def _evaluate(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: float, c2: float
    ) -> FrameWork:
        """The frame's scalar functions (`FrameWork`) at displacements and border unknowns x, v, a
        (n,); derivatives with dv = c1 dx, da = c2 dx."""
        f = self.frame
        work = FrameWork(f.p, f.border, f.generators)
        states = np.stack([x, v, a], axis=1)
        # forms (g, 3): x.Q_g x, x.Q_g v, x.Q_g a; the frame takes them form by form, (3 g,)
        forms = np.array([x @ (Q @ states) for Q in self.Q]).reshape(f.generators, 3)
        s = np.ascontiguousarray((self.D @ states).T)
        f.evaluate(*self._border(x, v, a, t), c1, c2, s, forms.T.ravel(), t, work)
        return work

    def _border(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rigid coordinates and attachment forces (b,), their rates and their second time
        derivatives."""
        border = (np.asarray(self.y0 + self.Y @ x), np.asarray(self.Y @ v), np.asarray(self.Y @ a))
        if self.guide is not None:
            for values, prescribed in zip(border, self.guide.at(t), strict=True):
                values[: len(prescribed)] += prescribed
        return border

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        """Residual r (m,) at unknowns x, rates v and second derivatives a (n,), t: s."""
        work, g = self._evaluate(x, v, a, t, c1=0.0, c2=0.0), self.frame.generators
        r = self.L @ work.border[:, -1] + self.W @ work.sigma[-1]
        for i, V in enumerate(self.V):
            u = work.coefficients[i] * x + work.coefficients[g + i] * v
            r = r + V @ (u + a if i == 0 and self.inert else u)
        return np.asarray(r, dtype=np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Matrix:
        """Exact Jacobian dr/dx (m, n) with dv = c1 dx, da = c2 dx; c1, c2 (n,) must be equal for
        all second-order unknowns. With dy = Y dx, ds = D dx and the derivatives of `FrameWork`,

            J = column Y + L (row + H Y) + sum_g (kappa_g + c1 mu_g) V_g + c2 V_m
            column (m, b) = W dsigma/dy + sum_g (V_g x dkappa_g/dy + V_g v dmu_g/dy)
            row (b, n) = tau D + derivatives of the rows by the forms x.Q_g x, x.Q_g v, x.Q_g a
        """
        k1, k2 = float(np.max(c1, initial=0.0)), float(np.max(c2, initial=0.0))
        w = self._evaluate(x, v, a, t, k1, k2)
        _, rates, accelerations = self._border(x, v, a, t)
        self.frame.exact(rates, accelerations, k1, k2, w)
        column, row = self.W @ w.sigma[:-1].T, w.tau @ self.D
        for g, V in enumerate(self.V):
            column = column + np.outer(V @ x, w.kappa_y[:, g]) + np.outer(V @ v, w.mu_y[:, g])
        for g, Q in enumerate(self.Q):
            tx = Q.T @ x  # d(x.Q v) = (Q v + c1 Q^T x).dx with dv = c1 dx, and so for a
            row = row + np.outer(w.quad[:, 0, g], Q @ x + tx)
            row = row + np.outer(w.quad[:, 1, g], Q @ v + k1 * tx)
            row = row + np.outer(w.quad[:, 2, g], Q @ a + k2 * tx)
        kappa, mu = w.coefficients[:-1].reshape(2, -1)
        factors = (kappa + k1 * mu).tolist()
        if self.V and self.inert:
            factors[0] += k2
        Y, L, H = self.Y, self.L, w.border[:, :-1]
        small = Y.shape[1] <= SMALL
        if small:
            Y, L = dense(Y), dense(L)
        elif not self.V or issparse(self.V[0]):  # few columns of Y and rows of L are not zero
            Y, L, column, row, H = map(csr_array, (Y, L, column, row, H))
        J = column @ Y + L @ (row + H @ Y)
        for factor, V in zip(factors, self.V, strict=True):
            J = J + factor * (dense(V) if small else V)
        return J

    def time_derivative(self, order: int, t: float, h: float) -> "FrameEquations | None":
        """Equations whose constraint rows are the partial time derivative of the given order (1 or
        2) at t (s), or None where that is zero; h: time step, s."""
        frame = self.frame.time_derivative(order, t, h) if self.inert else None
        return None if frame is None else replace(self, frame=frame)

    def restricted(self, keep: IntArray) -> "FrameEquations":
        return replace(self, L=self.L[keep], W=self.W[keep], V=tuple(V[keep] for V in self.V))

    def mapped(self, trial: Trial, left: FloatArray) -> "FrameEquations":
        """Projection on a trial basis, x = offset + atoms xi, and on the test basis `left` (l, m);
        the matrices become small and dense. What an offset o adds to y, s and the forms goes into
        y0, the frame (`Frame.shifted`) and the directions."""
        T, o = trial.atoms, trial.offset
        Qo = tuple(Q @ o for Q in self.Q)
        frame = self.frame
        W = self.W
        if np.any(o):
            s = np.asarray(self.D @ o)
            frame = frame.shifted(s, np.array([o @ q for q in Qo]))
        D, shifted = dense(self.D @ T), dict(frame.shape_columns)
        W = dense(left @ W)
        for column, g in shifted.items():  # a direction M_g X becomes M_g (X + offset)
            W[:, column] += left @ (self.V[g] @ o)
            D[column] += T.T @ Qo[g]
        for column, g in self.frame.stiff_columns:  # their functional D does not change
            W[:, column] += left @ (self.V[g] @ o)
        return replace(
            self, frame=frame, Y=dense(self.Y @ T), y0=self.y0 + self.Y @ o, D=D,
            Q=tuple(T.T @ dense(Q @ T) for Q in self.Q), L=dense(left @ self.L), W=W,
            V=tuple(dense(left @ dense(V @ T)) for V in self.V),
        )


def frame_rows(layout: Layout, record: FrameRecord) -> tuple[IntArray, IntArray, IntArray]:
    """Positions in the state vector of the rigid, elastic and multiplier unknowns that a force,
    constraint or inertia of a body acts on; of elastic ones those with a direction that is not
    zero, all for an inertia."""
    rigid, elastic = (layout.numbers(layout.name_of(record.body, q)) for q in (
        Quantity.POSE, Quantity.DISPLACEMENT))
    lam = layout.numbers(record.multipliers)
    used = slice(None) if record.generators else np.flatnonzero(
        np.any(record.directions != 0, axis=1))
    return rigid, elastic[used], lam


def frame_term(
    layout: Layout, body: BodyRecord, record: FrameRecord
) -> AssembledTerm[FrameEquations]:
    """Residual term of a single force, constraint or inertia that acts on a body's floating
    frame: `FrameEquations` with rows and columns at the unknowns that it reads or acts on: inputs
    y = Y x + y0, s = D x, forms x.Q_g x; rows L rows(y, s, ..) + W sigma + sum kappa_g V_g x .."""
    frame = body.kernel((record.item,))
    rigid, el, lam = frame_rows(layout, record)
    other, pose = layout.numbers(record.reads), len(body.pose)
    at = np.sort(np.concatenate([rigid, other, el, lam]))
    # positions among these unknowns: of the body's pose, another body's, displacements, multipliers
    own, read, mine, forces = (np.searchsorted(at, n) for n in (rigid, other, el, lam))
    # inputs of the frame y = Y x + y0: own pose, coordinates of the other body, attachment forces
    Y, y0 = np.zeros((frame.border, len(at))), np.zeros(frame.border)
    Y[np.arange(len(own)), own] = 1.0
    Y[pose + np.arange(len(read)), read] = 1.0
    if not body.moves and body.guide is None:
        y0[:pose] = body.pose
    if record.C is not None:
        Y[frame.rigid_size :, forces] = record.C.T
    D, W = np.zeros((frame.p, len(at))), np.zeros((len(at), frame.p))
    if frame.p:
        first = layout[layout.name_of(record.body, Quantity.DISPLACEMENT)].start
        P = record.directions[el - first]
        D[:, mine], W[mine] = P.T, P
    V = _embedded(record.generators, mine, len(at))
    # virtual work: rows act on the same unknowns as they read, L = Y^T and W = D^T
    return AssembledTerm(at, at, FrameEquations(
        frame, Y, y0, D, Q=V, L=Y.T.copy(), W=W, V=V, guide=body.guide), record.origin.part)


def stiffness_term(
    body: MovingBody, elastic: IntArray, border: IntArray
) -> AssembledTerm[FrameEquations]:
    """Residual term of the geometric stiffness by the loads of a body alone, on its displacements.
    elastic: positions of all its displacements in the state vector, (n,); border (N,): those of
    rigid coordinates and multipliers of the model. L, W and the matrices of the inertia's own
    generators are zero, so that of the residual only that of the further generators is left."""
    ops, frame = body.operators, body.frame
    assert ops is not None
    read = np.flatnonzero(body.to_border.any(axis=0))
    at = np.sort(np.concatenate([border[read], elastic]))
    # positions among the unknowns of the term, of displacements and of inputs of the frame
    mine, inputs = np.searchsorted(at, elastic), np.searchsorted(at, border[read])
    # own: number of generators of the inertia, which come first
    n, own = len(at), frame.generators - len(frame.stiff_columns)
    Y, D = np.zeros((frame.border, n)), np.zeros((frame.p, n))
    Y[:, inputs], D[:, mine] = body.to_border[:, read], ops.directions.T
    V = _embedded(ops.generators, mine, n)
    none = csr_array((len(mine), n))
    return AssembledTerm(elastic, at, FrameEquations(
        frame, csr_array(Y), body.origin, csr_array(D), Q=V,
        L=csr_array((len(mine), frame.border)), W=csr_array((len(mine), frame.p)),
        V=(*(none,) * own, *(H[mine] for H in V[own:])), guide=body.guide, inert=False),
        source=body.name)


def _embedded(matrices: tuple[Csr, ...], at: IntArray, size: int) -> tuple[Csr, ...]:
    """Matrices (n, n) embedded in zero matrices (size, size) at the rows and columns `at` (n,)."""
    embed = csr_array((np.ones(len(at)), (np.arange(len(at)), at)), shape=(len(at), size))
    return tuple(csr_array(embed.T @ A @ embed) for A in matrices)
