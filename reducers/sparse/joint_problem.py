"""Sparse recovery problems of one step (Eq. 25 of the paper), in the form that sparse solvers take.

Heat: P (B c - b) = 0 with the preconditioner P, linear, one block at a time; local terms
(radiation) enter only the subsequent solve on the selected support. Mechanics: the sampled rows of
all elastic blocks together with the equations of rigid coordinates and multipliers (the border), in
one problem; these unknowns form a group without a limit on its nonzeros. Elastic rows are scaled by
the largest column of their block, border rows by their own size divided by BORDER, because they are
equations that must be satisfied and not a sample. Sampled rows are compressed by an orthogonal
transformation (row_compression.py), which changes neither norms nor solutions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, Group, StepFormula
from sparsemor.core.protocols import FrameWork
from sparsemor.reducers.sparse.sampled_block import SampledElastic, SampledHeat
from sparsemor.reducers.step.condensed_newton import Mechanics
from sparsemor.reducers.step.frame_step import BodyStep, buffers
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.time_tables import plus_loads

Few = tuple[TestedElastic, FloatArray]
BORDER = 10.0


def shape_needs(rows: int, columns: int) -> frozenset[str]:
    """Capabilities of a sparse solver (`core.protocols.sparse_solver`) that a problem with this
    number of rows and columns requires."""
    if rows == columns:
        return frozenset()
    return frozenset({"overdetermined" if rows > columns else "underdetermined"})


def mechanics_needs(blocks: Sequence[SampledElastic], border: int) -> frozenset[str]:
    """Capabilities that the problem of all elastic blocks with `border` rigid coordinates and
    multipliers requires of its sparse solver."""
    shapes = [s.block.B.shape for s in blocks]
    rows, columns = (sum(shape[i] for shape in shapes) + border for i in (0, 1))
    return shape_needs(rows, columns) | {"nonlinear", "unpenalised"}


@dataclass(frozen=True, slots=True, eq=False)
class HeatProblem:
    """Linear problem J c - b of one thermal block: J (m, k) and b (m,) include the preconditioner
    and are scaled to a largest column norm of 1."""

    groups: tuple[Group, ...]
    J: FloatArray
    b: FloatArray
    needs: frozenset[str]

    @classmethod
    def at(cls, s: SampledHeat, r1: FloatArray, t: float) -> "HeatProblem":
        T, J = s.compressed
        b = plus_loads(T.constant - T.capacity @ r1, T, t)
        size = float(np.linalg.norm(J, axis=0).max())
        group = Group(s.block.name, 0, J.shape[1], s.block.budget)
        return cls((group,), J / size, b / size, shape_needs(*s.block.B.shape))

    def residual(self, c: FloatArray) -> FloatArray:
        return self.J @ c - self.b

    def jacobian(self, c: FloatArray) -> FloatArray:
        return self.J


@dataclass(frozen=True, slots=True, eq=False)
class BodyInProblem:
    """A body in the mechanical problem: compressed sampled rows (None for a rigid body), ranges of
    its columns and rows, scale of the rows, the part of the residual (m,) that is constant in the
    step, and the products `turned` (m, g) of the rotation matrices M_g with the past rates."""

    body: BodyStep
    few: Few | None
    columns: slice
    rows: slice
    scale: float
    fixed: FloatArray
    turned: FloatArray


class MechanicsProblem:
    """Nonlinear least-squares problem of all elastic blocks: unknowns [c of each block | rigid
    coordinates and multipliers], residual and Jacobian dense."""

    def __init__(
        self, mechanics: Mechanics, sampled: Sequence[SampledElastic | None], step: StepFormula,
        x: FloatArray,
    ) -> None:
        self.mechanics, self.step, self.x = mechanics, step, x
        self.r1, self.r2 = step.r1, step.r2
        self.members: list[BodyInProblem] = []
        groups, k, m = [], 0, 0
        for body, s in zip(mechanics.bodies, sampled, strict=True):
            if s is None:
                self.members.append(BodyInProblem(
                    body, None, slice(0, 0), slice(0, 0), 1.0, np.zeros(0), np.zeros((0, 0))))
                continue
            t, (rows, atoms) = s.compressed[0], s.compressed[1].shape
            size = float(np.linalg.norm(s.compressed[1], axis=0).max())
            self.members.append(BodyInProblem(
                body, s.compressed, slice(k, k + atoms), slice(m, m + rows), 1 / size,
                self._history(t, body), (t.generators @ self.r1[body.elastic]).T))
            groups.append(Group(s.block.name, k, k + atoms, s.block.budget))
            k, m = k + atoms, m + rows
        self.k, self.m, self.border = k, m, mechanics.size
        self.groups = (*groups, Group("border", k, k + self.border, None))
        self.needs = mechanics_needs([s for s in sampled if s is not None], self.border)
        self._at, self._both = np.zeros(0), (np.zeros(0), np.zeros((0, 0)))
        self._border_scale = np.ones(self.border)
        if self.border:
            size = np.linalg.norm(self._raw(self.start())[1][m:], axis=1)
            self._border_scale = BORDER / np.where(size > 0, size, 1.0)
            self._at = np.zeros(0)

    def start(self) -> FloatArray:
        """Initial guess: the predicted state."""
        nr = self.mechanics.n_rigid
        parts = [self.x[p.body.elastic] for p in self.members if p.few is not None]
        return np.concatenate([*parts, self.x[:nr], self.x[self.mechanics.algebraic]])

    def residual(self, c: FloatArray) -> FloatArray:
        return self._raw(c)[0]

    def jacobian(self, c: FloatArray) -> FloatArray:
        """Jacobian (m + border, k + border); the same array for all c where the motion of all
        frames is prescribed."""
        return self._raw(c)[1]

    def _raw(self, c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residual and Jacobian; the last ones are kept, because a solver evaluates both at one c.
        """
        if not np.array_equal(c, self._at):
            J = None if self.border or not len(self._at) else self._both[1]
            self._both, self._at = self._made(c, J), c.copy()
        return self._both

    def _made(
        self, c: FloatArray, constant: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Residual and Jacobian at c; constant: the Jacobian, if it is known."""
        step, me, y = self.step, self.mechanics, c[self.k :]
        r = np.zeros(self.m + self.border)
        J = np.zeros((self.m + self.border, len(c)), order="F") if constant is None else constant
        for i, f in me.targets:
            r[self.m + i] -= f(step.t)
        rates = np.zeros((2, me.size))
        rates[:, : me.n_rigid] = self.r1[: me.n_rigid], self.r2[: me.n_rigid]
        for p in self.members:
            w = self._evaluate(p, c[p.columns], y, rates)
            T = p.body.to_border
            r[self.m :] += w.border[:, -1] @ T
            J[self.m :, self.k :] += T.T @ w.border[:, :-1] @ T
            if p.few is None:
                continue
            t, B = p.few
            kappa, mu = w.coefficients[:-1].reshape(2, -1)
            own = J[p.rows, p.columns]
            if constant is None:
                plus_turned(own, B, kappa + step.c1 * mu, t.generators, p.scale)
            r[p.rows] = own @ c[p.columns] + p.scale * (
                p.fixed + p.turned @ mu + t.directions @ w.sigma[-1])
            J[p.rows, self.k :] = p.scale * (t.directions @ (w.sigma[:-1].T @ T))
            J[self.m :, p.columns] = T.T @ (w.tau @ t.functional)
        r[self.m :] *= self._border_scale
        J[self.m :] *= self._border_scale[:, None]
        return r, J

    def _evaluate(
        self, p: BodyInProblem, c: FloatArray, y: FloatArray, rates: FloatArray
    ) -> FrameWork:
        step, T = self.step, p.body.to_border
        w, = buffers([p.body.frame])
        c1, c2 = step.c1, step.c2
        motion = p.body.border_motion(step.t)
        yb = T @ y + motion[0]
        v, a = T @ (c1 * y + rates[0]) + motion[1], T @ (c2 * y + rates[1]) + motion[2]
        if not self.border:  # nothing rigid to solve for, and so no equations of it
            p.body.frame.drive(yb, v, a, step.t, w)
            return w
        at = p.body.elastic
        p.body.evaluate(yb, v, a, c1, c2, None if p.few is None else p.few[0], c,
                        c1 * c + self.r1[at], c2 * c + self.r2[at], step.t, w)
        return w

    def _history(self, t: TestedElastic, body: BodyStep) -> FloatArray:
        """Part of the rows that is constant in the step: inertia and damping of past states,
        temperatures, loads."""
        at = body.elastic
        h = t.mass @ self.r2[at] + t.damping @ self.r1[at] + t.constant
        if t.coupling.size:
            h = h - t.coupling @ self.x[body.thermal]
        return plus_loads(h, t, self.step.t, -1.0)


def plus_turned(
    into: FloatArray, B: FloatArray, factors: FloatArray, generators: FloatArray, scale: float
) -> None:
    """Writes scale (B + sum_g factors_g M_g) to `into` (m, k), from B (m, k) and the rotation
    matrices M_g (g, m, k)."""
    np.multiply(B, scale, out=into)
    for factor, M in zip((scale * factors).tolist(), generators, strict=True):
        if factor:
            into += factor * M
