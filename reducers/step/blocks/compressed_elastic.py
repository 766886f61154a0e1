"""Elastic block of a reduced model inside a step: all operators are dense and small, times D^-1 in
the tested rows (notation: elastic_block.py)."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core import Amplitude, FloatArray, IntArray
from sparsemor.core.protocols import FrameWork
from sparsemor.core.protocols.load_tables import total_load
from sparsemor.core.protocols.separable import evaluate_amplitudes
from sparsemor.reducers.linalg.active_columns import ActiveColumns, few
from sparsemor.reducers.step.acceptance import EPS
from sparsemor.reducers.step.blocks.elastic_block import ElasticBlock, History
from sparsemor.reducers.step.blocks.elastic_local import LocalForces, ReducedLocal
from sparsemor.reducers.step.operators import TestedElastic
from sparsemor.reducers.step.predictor import Prediction
from sparsemor.reducers.step.time_tables import Moving, tabulated


@dataclass(frozen=True, slots=True, eq=False)
class CompressedElastic(ElasticBlock):
    """Reduced elastic block with s active of k atoms: all operators are dense and small (s + p
    rows, not n).

    Vectors are stacked as [z; P^T z], so that one product gives both. H (s + p, 3 k + kt + j):
    matrix of h for the inputs u0, v0, a0, temperatures and load amplitudes; base (s + p,): its
    constant part. S (g (s + p) + g s + p, k): D^-1 M_g, M_g in the active rows, and P^T as
    factors of coefficients; step_S: the active columns of these for increments, times 1, c1 and c2
    where rates need them, and [0; P^T] next to the former; order: numbers of [S u0, S v0, S a0, h]
    in the same order. EG (s + p, p): [E; G]. tables: tabulated (for example moving) loads,
    projected on s + p rows; few: H and S where few atoms are active.
    """

    H: FloatArray
    base: FloatArray
    S: FloatArray
    step_S: FloatArray
    EG: FloatArray
    active: IntArray | None
    amplitudes: tuple[Amplitude, ...]
    sizes: tuple[int, int, int]
    order: IntArray
    tables: tuple[Moving, ...] = ()
    local: LocalForces | None = None
    few: tuple[ActiveColumns, ActiveColumns] | None = None

    @classmethod
    def of(
        cls, b: TestedElastic, left: FloatArray, support: IntArray | None, c1: float, c2: float
    ) -> "CompressedElastic":
        """Reduced block from the tested operators, for steps with c1 and c2; left (s, m): left
        inverse of the tested D on the support, left @ D_S = 1, as D^-1 in the tested rows."""
        k, p, g = b.mass.shape[1], b.functional.shape[0], len(b.generators)
        use = np.arange(k) if support is None else support
        s, F = len(use), b.functional[:, use]
        both = np.concatenate([left, F @ left])  # [D^-1; P^T D^-1] of tested rows
        rows = both @ np.hstack([
            b.stiffness, b.damping, b.mass, -b.coupling, -b.loads, b.directions,
            b.constant[:, None]])
        inputs = 3 * k + b.coupling.shape[1] + b.loads.shape[1]
        turned = (both @ b.generators).reshape(g * (s + p), k)
        forms = b.quadratic[:, use, :].reshape(g * s, k)
        S = np.concatenate([turned, forms, b.functional])
        each_rate = [np.concatenate([c * A for c in (1.0, c1, c2)])
                     for A in (forms, b.functional)]
        step_S = np.concatenate(
            [turned, c1 * turned, np.zeros((s, k)), b.functional, *each_rate])[:, use]
        numbers, n, m = np.arange(3 * len(S)).reshape(3, -1), len(turned), len(turned) + len(forms)
        order = np.concatenate((
            numbers[0, :n], numbers[1, :n], np.arange(numbers.size, numbers.size + s + p),
            numbers[:, n:m].ravel(), numbers[:, m:].ravel()))
        H = np.ascontiguousarray(rows[:, :inputs])
        some = (ActiveColumns(H), ActiveColumns(S)) if few(support, k) else None
        return cls(H, rows[:, -1].copy(), S, np.ascontiguousarray(step_S),
                   np.ascontiguousarray(rows[:, inputs:-1]), support, b.amplitudes, (s, p, g),
                   order, tabulated(b.tables, both, support is None),
                   ReducedLocal.of(b.local, both), some)

    def rates(self, k: int) -> tuple[FloatArray, FloatArray]:
        rows = self.H[: self.sizes[0]]
        return rows[:, k : 2 * k], rows[:, 2 * k : 3 * k]

    def begin(self, at: Prediction, c1: float, c2: float) -> History:
        parts = [at.x, at.v, at.a, at.T]
        if self.amplitudes:
            parts.append(evaluate_amplitudes(self.amplitudes, at.t))
        inputs = np.concatenate(parts)
        k, h = len(at.x), History(at, c1, c2)
        h.h = self.H.dot(inputs) if self.few is None else self.few[0].times(inputs)
        h.h += self.base
        if self.tables:
            h.h -= total_load(self.tables, at.t)
        past = inputs[: 3 * k].reshape(3, k)
        out = past.dot(self.S.T) if self.few is None else self.few[1].times(past)
        h.products = np.concatenate((out.ravel(), h.h)).take(self.order)
        h.u = at.x if self.active is None else at.x[self.active]
        self._evaluate(h, h.products, h.u)
        return h

    def move(self, d: FloatArray, history: History) -> None:
        self._evaluate(history, history.products + self.step_S.dot(d), history.u + d)

    def _evaluate(self, history: History, products: FloatArray, u: FloatArray) -> None:
        """Terms at the displacements u (s,); products: in the order of step_S."""
        s, p, g = self.sizes
        n = (2 * g + 1) * (s + p)
        m = n + 3 * g * s
        history.stack = products[:n].reshape(2 * g + 1, s + p)
        history.forms = products[n:m].reshape(3 * g, s).dot(u)
        history.s = products[m:].reshape(3, p)

    def condensed(self, d: FloatArray, history: History, work: FrameWork) -> FloatArray:
        rows, s = work.sigma.dot(self.EG.T), self.sizes[0]
        rows[-1] += work.coefficients.dot(history.stack)
        if history.local is not None:
            rows[-1] += history.local.rows(d)
        history.terms = (rows[:, :s],)
        return np.asarray(rows[:, s:].T)

    def increment(self, history: History, dy: FloatArray) -> FloatArray:
        rows, = history.terms
        return np.asarray(dy.dot(rows[:-1]) - rows[-1])

    def response(self, sigma: FloatArray) -> FloatArray:
        return self.EG[: self.sizes[0]] @ sigma

    def noise(self, d: FloatArray, history: History, factors: FloatArray) -> float:
        s, p, g = self.sizes
        n, at = 2 * g * (s + p), history.at
        inputs = np.concatenate([at.x, at.v, at.a, at.T])
        terms = np.abs(self.H[:, : len(inputs)]) @ np.abs(inputs) + np.abs(self.base)
        turned = np.abs(self.step_S[:n]) @ np.abs(d) + np.abs(history.products[:n])
        terms += np.abs(factors[:-1]) @ turned.reshape(2 * g, s + p)
        return EPS * float(np.linalg.norm(terms[:s]))
