"""A frame kernel as a Term: the general (row by row) face of the separable equations.

Residual, with y = Y x the border unknowns and s = D x the functionals of the displacement:

    r = L rows(y, s, ...) + W sigma + sum_g (kappa_g V_g x + mu_g V_g v) + V_m a

The matrices are sparse for a full-order term and small and dense for a compressed one; the sums
are the same, so both are this one class (law: compress == left @ residual).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.sparse import csr_array, issparse

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols import Trial
from sparsemor.core.separable import Frame, FrameWork
from sparsemor.core.stage import FrameHistory


def _dense(matrix: Any) -> FloatArray:
    return np.asarray(matrix.toarray() if issparse(matrix) else matrix, dtype=np.float64)


class Item(Protocol):
    """A part of a frame's equations: inertia, a force, an attachment."""

    @property
    def forces(self) -> int:
        """Number of its forces that are unknown: those of a joint, its multipliers."""
        ...

    def names(self, source: str) -> tuple[str, ...]:
        """What each of its directions is a load of; "" where it only serves the frame's rows."""
        ...


class BodyFrame(Frame, Protocol):
    """A frame whose equations are a sum of items."""

    @property
    def items(self) -> Sequence[Item]: ...
    @property
    def without_push(self) -> Sequence[Item]:
        """Items that `drive` cannot evaluate although they act on displacements."""
        ...
    def shifted(self, s: FloatArray, quadratic: FloatArray) -> "BodyFrame": ...
    def time_derivative(self, order: int, t: float, h: float) -> "BodyFrame | None": ...


@dataclass(frozen=True, slots=True, eq=False)
class FrameEquations:
    """The sum above for n columns and m rows. b border unknowns, p directions, g generators.

    Y (b, n), D (p, n), Q: g matrices (n, n) of the quadratic forms, L (m, b), W (m, p),
    V: g matrices (m, n) (the first is the mass), y0 (b,) values that are not unknowns. guide: the
    motion of a frame that is given, added to y = Y x + y0 and its rates.
    """

    frame: BodyFrame
    Y: Any
    y0: FloatArray
    D: Any
    Q: tuple[Any, ...]
    L: Any
    W: Any
    V: tuple[Any, ...]
    guide: FrameHistory | None = None

    @property
    def elements(self) -> int:
        return 0

    def _evaluate(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: float, c2: float
    ) -> FrameWork:
        f = self.frame
        work = FrameWork(f.p, f.border, f.generators)
        r1, r2 = v - c1 * x, a - c2 * x
        form, forms = np.zeros(f.generators), np.zeros((2, f.generators))
        for g, Q in enumerate(self.Q):
            form[g], forms[:, g] = x @ (Q @ x), (x @ (Q @ r1), x @ (Q @ r2))
        f.evaluate(*self._border(x, v, a, t), c1, c2,
                   self.D @ x, self.D @ r1, self.D @ r2, form, forms.ravel(), t, work)
        return work

    def _border(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(b,) each: border unknowns, rates and accelerations."""
        border = (np.asarray(self.y0 + self.Y @ x), np.asarray(self.Y @ v), np.asarray(self.Y @ a))
        if self.guide is not None:
            for values, known in zip(border, self.guide.at(t), strict=True):
                values[: len(known)] += known
        return border

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        w, g = self._evaluate(x, v, a, t, 0.0, 0.0), self.frame.generators
        r = self.L @ w.border[:, -1] + self.W @ w.sigma[-1]
        for i, V in enumerate(self.V):
            r = r + V @ (w.coefficients[i] * x + w.coefficients[g + i] * v)
        if self.V:
            r = r + self.V[0] @ a
        return np.asarray(r, dtype=np.float64)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Any:
        """Exact; c1, c2 must be the same for all second-order columns."""
        k1, k2 = float(np.max(c1, initial=0.0)), float(np.max(c2, initial=0.0))
        w = self._evaluate(x, v, a, t, k1, k2)
        _, rates, accelerations = self._border(x, v, a, t)
        self.frame.exact(rates, accelerations, k1, k2, w)
        column, row = self.W @ w.sigma[:-1].T, w.tau @ self.D
        for g, V in enumerate(self.V):
            column = column + np.outer(V @ x, w.kappa_y[:, g]) + np.outer(V @ v, w.mu_y[:, g])
        for g, Q in enumerate(self.Q):
            tx = Q.T @ x
            row = row + np.outer(w.quad[:, 0, g], Q @ x + tx)
            row = row + np.outer(w.quad[:, 1, g], Q @ v + k1 * tx)
            row = row + np.outer(w.quad[:, 2, g], Q @ a + k2 * tx)
        factors = w.coefficients[: len(self.V)].tolist()
        if self.V:
            factors[0] += k2
        Y, L, H = self.Y, self.L, w.border[:, :-1]
        if not self.V or issparse(self.V[0]):  # few columns of Y and few rows of L are not zero
            Y, L, column, row, H = (csr_array(m) for m in (Y, L, column, row, H))
        J = column @ Y + L @ (row + H @ Y)
        for factor, V in zip(factors, self.V, strict=True):
            J = J + factor * V
        return J

    def mapped(self, trial: Trial, left: FloatArray) -> "FrameEquations":
        """Trial and test maps applied: the mesh-sized dimension disappears."""
        T, o = trial.atoms, trial.offset
        Qo = tuple(Q @ o for Q in self.Q)
        frame = self.frame
        W = self.W
        if np.any(o):
            s = np.asarray(self.D @ o)
            frame = frame.shifted(s, np.array([o @ q for q in Qo]))
        D, shifted = _dense(self.D @ T), dict(frame.shape_columns)
        W = _dense(left @ W)
        for column, g in shifted.items():  # a direction M_g X becomes M_g (X + offset)
            W[:, column] += left @ (self.V[g] @ o)
            D[column] += T.T @ Qo[g]
        return replace(
            self, frame=frame, Y=_dense(self.Y @ T), y0=self.y0 + self.Y @ o, D=D,
            Q=tuple(T.T @ _dense(Q @ T) for Q in self.Q), L=_dense(left @ self.L), W=W,
            V=tuple(_dense(left @ _dense(V @ T)) for V in self.V),
        )


@dataclass(frozen=True, slots=True, eq=False)
class FrameTerm:
    """Equations of one frame at global `rows` (m,) and `columns` (n,); no element is visited.

    `body` names its owner, which recognises its own terms and takes them apart for fast steps;
    `source` the part of the scene that it comes from, set in assembly.
    """

    body: str
    rows: IntArray
    columns: IntArray
    equations: FrameEquations
    elements: int = 0
    source: str = ""

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.equations.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Any:
        return csr_array(self.equations.jacobian(x, v, a, t, c1, c2))

    def time_derivative(self, order: int, t: float, h: float) -> "FrameTerm | None":
        """Of its constraint rows; joints that are unknown hold no frame that is prescribed."""
        frame = self.equations.frame.time_derivative(order, t, h)
        return None if frame is None else replace(
            self, equations=replace(self.equations, frame=frame))

    def restrict(self, keep: IntArray) -> "FrameTerm":
        e = self.equations
        kept = replace(e, L=e.L[keep], W=e.W[keep], V=tuple(V[keep] for V in e.V))
        return replace(self, rows=self.rows[keep], equations=kept)

    def compress(self, trial: Trial, left: FloatArray) -> FrameEquations:
        return self.equations.mapped(trial, left)
