"""Modified Newton for rigid coordinates, multipliers and elastic blocks of one step.

The elastic blocks are eliminated with their constant operator D (elastic.py), which leaves a small
border of rigid coordinates and multipliers (Schur complement). The residual is exact; the Jacobian
leaves out the terms quadratic in u, so the iteration contracts linearly and fast. It stops on the
error that is estimated to remain, not on the size of the last change.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg.lapack import dgesv

from sparsemor.core.arrays import FloatArray, IntArray
from sparsemor.core.protocols import StepFormula
from sparsemor.core.separable import Amplitude, Frame, FrameWork
from sparsemor.core.status import Status
from sparsemor.reducers.elastic import ElasticBlock


@dataclass(frozen=True, slots=True, eq=False)
class BodyStep:
    """One body in the loop: its kernel, its map to the border, and where its unknowns sit."""

    name: str
    frame: Frame
    to_border: FloatArray
    block: ElasticBlock | None
    elastic: slice
    thermal: slice
    elastic_name: str


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Relative error that may remain in each unknown, and when to give up."""

    remaining: float = 1e-13
    max_iterations: int = 30


class Contraction:
    """Observed ratio of successive changes; lives in the step memory."""

    __slots__ = ("age", "ratio", "scale")

    def __init__(self, bodies: int) -> None:
        self.ratio, self.age = 1.0, 0
        self.scale = [0.0] * bodies


class Mechanics:
    """The mechanical equations of one step under fixed (c1, c2): immutable but for scratch."""

    def __init__(
        self, bodies: Sequence[BodyStep], n_rigid: int, algebraic: slice,
        targets: Sequence[tuple[int, Amplitude]], tolerances: Tolerances,
    ) -> None:
        self.bodies, self.n_rigid, self.algebraic = tuple(bodies), n_rigid, algebraic
        self.size = n_rigid + algebraic.stop - algebraic.start
        self.targets, self.tol = tuple(targets), tolerances
        self.work = [FrameWork(b.frame.p, b.frame.border, b.frame.generators) for b in bodies]

    def solve(
        self, step: StepFormula, x: FloatArray, memory: Contraction
    ) -> tuple[Status, int, str, str]:
        """Improves x in place from its guess; status, iterations, block, what was seen."""
        r1, r2, nr = step.r1, step.r2, self.n_rigid
        history = [None if b.block is None else
                   b.block.begin(r1[b.elastic], r2[b.elastic], x[b.thermal], step.t)
                   for b in self.bodies]
        rates = np.zeros((2, self.size))
        rates[0, :nr], rates[1, :nr] = r1[:nr], r2[:nr]
        rates_of = [T @ rates.T for T in (b.to_border for b in self.bodies)]
        given = np.zeros(self.size)
        for i, f in self.targets:
            given[i] = f(step.t)
        y = np.concatenate((x[:nr], x[self.algebraic]))
        last, where = np.inf, 0
        for iteration in range(1, self.tol.max_iterations + 1):
            change, where = self._iterate(step, x, y, history, rates_of, given, memory)
            if change != change or change == np.inf:
                return Status.NOT_FINITE, iteration, self._name(where), ""
            if change < 0:
                return Status.SINGULAR, iteration, "", "the border matrix is singular"
            if last < np.inf and last > 0:
                memory.ratio, memory.age = min(max(change / last, 1e-12), 1.0), 0
            memory.age += 1
            # an unmeasured or old ratio is not trusted: iterate once more
            known = memory.ratio if memory.age <= 200 and memory.ratio < 0.5 else 1.0
            left = change * known / (1.0 - known) if known < 0.5 else change
            if left <= self.tol.remaining or (change >= 0.25 * last and change <= 1e-10):
                x[:nr], x[self.algebraic] = y[:nr], y[nr:]
                return Status.DONE, iteration, "", ""
            last = change
        detail = f"last relative change {change:.1e} after {self.tol.max_iterations} iterations"
        return Status.NOT_CONVERGED, self.tol.max_iterations, self._name(where), detail

    def _name(self, where: int) -> str:
        if where < 0:
            return "rigid"
        return self.bodies[where].elastic_name or f"{self.bodies[where].name}.rigid"

    def _iterate(
        self, step: StepFormula, x: FloatArray, y: FloatArray, history: list[Any],
        rates_of: list[FloatArray], given: FloatArray, memory: Contraction,
    ) -> tuple[float, int]:
        """One Newton step; the largest relative change and the body it is in (-1: rigid)."""
        c1, c2 = step.c1, step.c2
        B, r, kept = np.zeros((self.size, self.size)), -given, []
        for b, w, past, rates in zip(self.bodies, self.work, history, rates_of, strict=True):
            T = b.to_border
            yb = T.dot(y)
            v, a = c1 * yb + rates[:, 0], c2 * yb + rates[:, 1]
            if b.block is None:
                b.frame.evaluate(yb, v, a, c1, c2, _NONE, _NONE, _NONE, _NONE, step.t, w)
                r += w.rows.dot(T)
                B += T.T.dot(w.H.dot(T))
                continue
            c = x[b.elastic] if b.block.active is None else x[b.elastic][b.block.active]
            s, forms, seen = b.block.look(c, past)
            forms[1] += c1 * forms[0]
            forms[2] += c2 * forms[0]
            b.frame.evaluate(yb, v, a, c1, c2, s, c1 * s + past.s1, c2 * s + past.s2, forms,
                             step.t, w)
            z, Pz = b.block.combine(seen, past, w.kappa + c1 * w.mu, w.mu)
            G = b.block.G
            r += (w.rows - w.tau.dot(s + Pz + G.dot(w.sigma))).dot(T)
            B += T.T.dot((w.H - w.tau.dot(G.dot(w.sigma_y.T))).dot(T))
            kept.append((b, w, z, c))
        return self._advance(x, y, B, r, kept, memory)

    def _advance(
        self, x: FloatArray, y: FloatArray, B: FloatArray, r: FloatArray, kept: list[Any],
        memory: Contraction,
    ) -> tuple[float, int]:
        change, where = 0.0, -1
        if self.size:
            _, _, dy, info = dgesv(B, r, 1, 1)
            if info > 0:
                return -1.0, -1
            y -= dy
            if self.n_rigid:
                change = float(np.abs(dy[: self.n_rigid]).max())
                change /= max(1.0, float(np.abs(y[: self.n_rigid]).max()))
        else:
            dy = r
        for i, (b, w, z, c) in enumerate(kept):
            new = b.block.update(z, w.sigma - (b.to_border.dot(dy)).dot(w.sigma_y))
            d = float(np.abs(new - c).max())
            scale = memory.scale[i] = max(memory.scale[i], float(np.abs(new).max()))
            if b.block.active is None:
                x[b.elastic] = new
            else:
                whole = np.zeros(b.elastic.stop - b.elastic.start)
                whole[b.block.active] = new
                x[b.elastic] = whole
            if scale > 0 and not d <= change * scale:
                change, where = d / scale, i
        return change, where


_NONE = np.zeros(0)


def border_numbers(n_rigid: int, algebraic: slice) -> IntArray:
    """Positions of the border unknowns in the flat vector."""
    return np.concatenate([np.arange(n_rigid), np.arange(algebraic.start, algebraic.stop)])
