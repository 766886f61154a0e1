"""Equations of a reduced model as small dense arrays: projected bodies, and terms that couple them.

Elastic and thermal rows are multiplied by the left inverse of the block's own operator, so that
each diagonal block of the Jacobian is near the identity. Rows of rigid coordinates and multipliers
and terms that couple bodies are added, and the Jacobian is exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import issparse

from sparsemor.core import Amplitude, FloatArray, FrameWork, IntArray, Layout, ReducedTerm
from sparsemor.reducers.step.frame_step import BodyStep, buffers
from sparsemor.reducers.step.newton.factors import factorized
from sparsemor.reducers.step.newton.memory import Factor, NewtonMemory
from sparsemor.reducers.step.operators import TestedElastic, TestedHeat
from sparsemor.reducers.step.rejection import Checked
from sparsemor.reducers.step.relocalised import Coupled
from sparsemor.reducers.step.time_tables import plus_loads


@dataclass(frozen=True, slots=True, eq=False)
class DenseHeat:
    """Projected rows of one thermal block, multiplied by the left inverse of its operator."""

    at: slice
    tested: TestedHeat

    def prescribed(self, t: float) -> FloatArray:
        return -plus_loads(self.tested.constant, self.tested, t)

    def residual(self, r: FloatArray, x: FloatArray, v: FloatArray) -> None:
        at, b = self.at, self.tested
        r[at] += b.conductivity.dot(x[at]) + b.capacity.dot(v[at])

    def jacobian(self, J: FloatArray, c1: float) -> None:
        J[self.at, self.at] += self.tested.conductivity + c1 * self.tested.capacity


class DenseBody:
    """One body's rigid coordinates, attachment forces and elastic block; tested: None where it has
    no elastic block. border (N,): positions of rigid unknowns and multipliers in the vector of
    unknowns."""

    def __init__(self, step: BodyStep, tested: TestedElastic | None, border: IntArray) -> None:
        self.step, self.tested, self.border = step, tested, border
        used = np.any(step.to_border != 0.0, axis=0)  # of all rigid unknowns and multipliers
        self.at, self.map = border[used], np.ascontiguousarray(step.to_border[:, used])

    def parts(self) -> tuple[Any, ...]:
        return self.step, self.tested, self.border

    @classmethod
    def of_parts(cls, *parts: Any) -> "DenseBody":
        return cls(*parts)

    def prescribed(self, t: float) -> FloatArray:
        assert self.tested is not None
        return plus_loads(self.tested.constant, self.tested, t, -1.0)

    def _evaluate(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: float, c2: float,
        work: FrameWork,
    ) -> tuple[FloatArray, FloatArray]:
        """Evaluates the frame in `work`; returns first and second rates of the border unknowns."""
        at, T = self.at, self.map
        y, yv, ya = T.dot(x[at]), T.dot(v[at]), T.dot(a[at])
        if self.step.guide is None:
            y = y + self.step.origin
        else:
            motion = self.step.border_motion(t)
            y, yv, ya = y + motion[0], yv + motion[1], ya + motion[2]
        e = self.step.elastic
        c = x[e]
        self.step.evaluate(y, yv, ya, c1, c2, self.tested, c, v[e], a[e], t, work)
        return yv, ya

    def residual(
        self, r: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray, t: float, w: FrameWork
    ) -> None:
        self._evaluate(x, v, a, t, 0.0, 0.0, w)
        b = self.tested
        r[self.at] += w.border[:, -1].dot(self.map)
        if b is None:
            return
        e = self.step.elastic
        kappa, mu = w.coefficients[:-1].reshape(2, -1)
        r[e] += (b.stiffness.dot(x[e]) + b.damping.dot(v[e]) + b.mass.dot(a[e])
                 + b.directions.dot(w.sigma[-1])
                 + kappa.dot(b.generators.dot(x[e])) + mu.dot(b.generators.dot(v[e])))
        if b.coupling.size:
            r[e] -= b.coupling.dot(x[self.step.thermal])

    def border_blocks(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: float, c2: float,
        w: FrameWork,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Derivatives of the rigid rows by the n rigid unknowns of the body, (n, n), of its k
        elastic rows by them, (k, n), and of the rigid rows by its elastic unknowns, (n, k)."""
        yv, ya = self._evaluate(x, v, a, t, c1, c2, w)
        b, T, e = self.tested, self.map, self.step.elastic
        corner = T.T @ w.border[:, :-1] @ T
        if b is None:
            return corner, np.zeros((0, len(self.at))), np.zeros((len(self.at), 0))
        self.step.frame.exact(yv, ya, c1, c2, w)
        c, cv, ca, G, Q = x[e], v[e], a[e], b.generators, b.quadratic
        column = (b.directions @ w.sigma[:-1].T + G.dot(c).T @ w.kappa_y.T
                  + G.dot(cv).T @ w.mu_y.T)
        turned = c @ Q  # (g, k): Q^T c
        forms = np.stack([Q.dot(c) + turned, Q.dot(cv) + c1 * turned, Q.dot(ca) + c2 * turned])
        row = w.tau @ b.functional + np.tensordot(w.quad, forms, 2)
        return corner, column @ T, T.T @ row

    def jacobian(
        self, J: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: float,
        c2: float, w: FrameWork,
    ) -> None:
        corner, column, row = self.border_blocks(x, v, a, t, c1, c2, w)
        b, e = self.tested, self.step.elastic
        J[np.ix_(self.at, self.at)] += corner
        if b is None:
            return
        J[e, self.at] += column
        J[self.at, e] += row
        kappa, mu = w.coefficients[:-1].reshape(2, -1)
        J[e, e] += (b.stiffness + c1 * b.damping + c2 * b.mass
                    + np.tensordot(kappa + c1 * mu, b.generators, 1))
        if b.coupling.size:
            J[e, self.step.thermal] -= b.coupling


@dataclass(frozen=True, slots=True, eq=False)
class Dense:
    """Equations of a whole step for Newton's method, of a reduced model or of rigid bodies.

    step: step size, s; targets: prescribed constraint values; border: positions of rigid unknowns
    and multipliers; work: working arrays of the bodies' frames, of one run or one thread
    (`with_work`).
    """

    layout: Layout
    heat: Sequence[DenseHeat]
    bodies: Sequence[DenseBody]
    coupled: Sequence[Coupled]
    targets: Sequence[tuple[int, Amplitude]]
    border: IntArray
    step: float
    named: Sequence[tuple[str, frozenset[str]]] = ()
    price: int = 4
    work: Sequence[FrameWork] = ()

    @property
    def terms(self) -> list[tuple[ReducedTerm, IntArray]]:
        return [(c.term, c.columns) for c in self.coupled]

    @property
    def checks(self) -> list[Checked]:
        return [(c.checks, c.columns) for c in self.coupled if c.checks is not None]

    def of_run(self, memory: NewtonMemory) -> "Dense":
        coupled = [c.by_copies(i, memory) for i, c in enumerate(self.coupled)]
        return replace(self, coupled=coupled, work=memory.work)

    def with_work(self) -> "Dense":
        """These equations with new working arrays."""
        return replace(self, work=self.buffers())

    def buffers(self) -> list[FrameWork]:
        """Working arrays for all bodies."""
        return buffers([b.step.frame for b in self.bodies])

    def prescribed(self, t: float) -> FloatArray:
        r = np.zeros(self.layout.size)
        for i, f in self.targets:
            r[self.border[i]] -= f(t)
        for h in self.heat:
            r[h.at] += h.prescribed(t)
        for b in self.bodies:
            if b.tested is not None:
                r[b.step.elastic] += b.prescribed(t)
        return r

    def residual(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, prescribed: FloatArray
    ) -> FloatArray:
        r = prescribed.copy()
        for h in self.heat:
            h.residual(r, x, v)
        for b, w in zip(self.bodies, self.work, strict=True):
            b.residual(r, x, v, a, t, w)
        for c in self.coupled:
            j = c.columns
            r[c.rows] += c.term.residual(x[j], v[j], a[j], t)
        return r

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        n, first = self.layout.size, self.layout.first
        J = np.zeros((n, n))
        rate, k1, k2 = (float(c.max(initial=0.0)) for c in (
            c1[first], c1[self.layout.second], c2[self.layout.second]))
        for h in self.heat:
            h.jacobian(J, rate)
        for b, w in zip(self.bodies, self.work, strict=True):
            b.jacobian(J, x, v, a, t, k1, k2, w)
        for c in self.coupled:
            j = c.columns
            J[np.ix_(c.rows, j)] += _dense(
                c.term.jacobian(x[j], v[j], a[j], t, c1[j], c2[j]))
        return J

    def factorize(self, J: FloatArray) -> Factor:
        return factorized(J)

    def time_derivative(self, order: int, t: float) -> "Dense":
        """Partial time derivative of this order of the bodies' constraint rows, at t, s."""
        frames = ((b, b.step.frame.time_derivative(order, t, self.step)) for b in self.bodies)
        bodies = [DenseBody(replace(b.step, frame=f), b.tested, b.border)
                  for b, f in frames if f is not None]
        return replace(self, heat=(), bodies=bodies, coupled=(), targets=()).with_work()


def _dense(matrix: Any) -> FloatArray:
    return np.asarray(matrix.toarray() if issparse(matrix) else matrix)
