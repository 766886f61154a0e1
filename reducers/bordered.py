"""Modified Newton for rigid coordinates, multipliers and elastic blocks of one step.

The elastic blocks are eliminated with their constant operator D (elastic.py), which leaves a small
border of rigid coordinates and multipliers (Schur complement). The residual is exact; the Jacobian
leaves out the terms quadratic in u, so the iteration contracts linearly and fast. It stops on the
error that is estimated to remain, not on the size of the last change.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from scipy.linalg.lapack import dgesv

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols import StepFormula
from sparsemor.core.separable import Amplitude, Frame, FrameWork
from sparsemor.core.status import Status
from sparsemor.reducers.elastic import ElasticBlock, History


@dataclass(frozen=True, slots=True, eq=False)
class BodyStep:
    """One body in the loop: its kernel, its map to the border, and where its unknowns sit."""

    name: str
    frame: Frame
    to_border: FloatArray
    origin: FloatArray
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
    """Observed ratio of successive changes, the largest |u|^2 so far, and |du|^2 that round-off
    alone makes; lives in the step memory."""

    __slots__ = ("age", "floor", "ratio", "scale")

    def __init__(self) -> None:
        self.ratio, self.age, self.scale, self.floor = 1.0, 0, 0.0, -1.0


class _Loop:
    """What one step keeps between its iterations: `given` targets of the constraints, rates of
    the stacked borders at y = 0, the border unknowns y, and per body its unknowns c and z."""

    __slots__ = ("acceleration", "c", "given", "history", "velocity", "y", "z")

    history: list[History | None]
    given: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    y: FloatArray
    c: list[FloatArray]
    z: list[FloatArray]


class Mechanics:
    """The mechanical equations of one step under fixed (c1, c2): immutable but for scratch.

    The bodies' borders are stacked: `map` (sum b, N) takes the global border to all of them.
    """

    def __init__(
        self, bodies: Sequence[BodyStep], n_rigid: int, algebraic: slice,
        targets: Sequence[tuple[int, Amplitude]], tolerances: Tolerances,
    ) -> None:
        self.bodies, self.n_rigid, self.algebraic = tuple(bodies), n_rigid, algebraic
        self.size = n_rigid + algebraic.stop - algebraic.start
        self.targets, self.tol = tuple(targets), tolerances
        self.work = [FrameWork(b.frame.p, b.frame.border, b.frame.generators) for b in bodies]
        self.map = np.concatenate([np.zeros((0, self.size)), *(b.to_border for b in bodies)])
        self.origin = np.concatenate([np.zeros(0), *(b.origin for b in bodies)])
        edges = np.cumsum([0, *(b.frame.border for b in bodies)]).tolist()
        self.at = [slice(i, j) for i, j in zip(edges, edges[1:], strict=False)]
        self._H, self._rows = np.zeros((edges[-1], edges[-1])), np.zeros(edges[-1])

    def solve(
        self, step: StepFormula, x: FloatArray, memory: Contraction
    ) -> tuple[Status, int, str, str]:
        """Improves x in place from its guess; status, iterations, block, what was seen."""
        loop, nr = self._begin(step, x), self.n_rigid
        last = inf
        for iteration in range(1, self.tol.max_iterations + 1):
            change = self._iterate(step, x, loop, memory)
            if not change < inf:
                return Status.NOT_FINITE, iteration, self._worst(x, loop), ""
            if change < 0:
                return Status.SINGULAR, iteration, "", "the border matrix is singular"
            if 0 < last < inf:
                memory.ratio, memory.age = min(max(change / last, 1e-12), 1.0), 0
            memory.age += 1
            # an unmeasured or old ratio is not trusted: iterate once more
            trusted = memory.age <= 200 and memory.ratio < 0.5
            left = change * memory.ratio / (1.0 - memory.ratio) if trusted else change
            if left <= self.tol.remaining or (change >= 0.25 * last and change <= ROUND_OFF):
                x[:nr], x[self.algebraic] = loop.y[:nr], loop.y[nr:]
                return Status.DONE, iteration, "", ""
            last = change
        detail = f"last relative change {change:.1e} after {self.tol.max_iterations} iterations"
        return Status.NOT_CONVERGED, self.tol.max_iterations, self._worst(x, loop), detail

    def _begin(self, step: StepFormula, x: FloatArray) -> _Loop:
        loop, r1, r2, nr = _Loop(), step.r1, step.r2, self.n_rigid
        loop.history = [
            None if b.block is None else
            b.block.begin(r1[b.elastic], r2[b.elastic], x[b.thermal], step.t) for b in self.bodies]
        loop.given = np.zeros(self.size)
        for i, f in self.targets:
            loop.given[i] = f(step.t)
        rigid = self.map[:, :nr]
        loop.velocity, loop.acceleration = rigid.dot(r1[:nr]), rigid.dot(r2[:nr])
        loop.y = np.concatenate((x[:nr], x[self.algebraic]))
        return loop

    def _iterate(
        self, step: StepFormula, x: FloatArray, loop: _Loop, memory: Contraction
    ) -> float:
        """One Newton step; the largest relative change (-1: singular)."""
        c1, c2, H, rows = step.c1, step.c2, self._H, self._rows
        moving = self.map.dot(loop.y)
        v, a = c1 * moving + loop.velocity, c2 * moving + loop.acceleration
        y = moving + self.origin
        loop.c, loop.z = [], []
        for b, w, past, at in zip(self.bodies, self.work, loop.history, self.at, strict=True):
            if b.block is None or past is None:
                b.frame.evaluate(y[at], v[at], a[at], c1, c2, _NONE, _NONE, _NONE, _NONE, _NONE,
                                 step.t, w)
                H[at, at], rows[at] = w.border[:, :-1], w.border[:, -1]
                continue
            c = x[b.elastic] if b.block.active is None else x[b.elastic][b.block.active]
            look = b.block.look(c, past)
            b.frame.evaluate(y[at], v[at], a[at], c1, c2, look.s, past.s1, past.s2, look.form,
                             look.forms, step.t, w)
            z, Pz = b.block.combine(look, past, w.coefficients)
            # border minus tau D^-1 (elastic columns and residual): the Schur complement
            Gs = b.block.G.dot(w.sigma.T)
            Gs[:, -1] += look.s + Pz
            reduced = w.border - w.tau.dot(Gs)
            H[at, at], rows[at] = reduced[:, :-1], reduced[:, -1]
            loop.c.append(c)
            loop.z.append(z)
        return self._advance(x, loop, memory)

    def _advance(self, x: FloatArray, loop: _Loop, memory: Contraction) -> float:
        change, nr = 0.0, self.n_rigid
        if self.size:
            B = self.map.T.dot(self._H.dot(self.map))
            dy, info = dgesv(B, self._rows.dot(self.map) - loop.given, 1, 1)[2:]
            if info > 0:
                return -1.0
            loop.y = loop.y - dy
            if nr:
                d, q = dy[:nr], loop.y[:nr]
                change = sqrt(float(d.dot(d)) / max(1.0, float(q.dot(q))))
        else:
            dy = loop.y
        moved, elastic, size, number = self.map.dot(dy), 0.0, 0.0, 0
        for b, w, at in zip(self.bodies, self.work, self.at, strict=True):
            if b.block is None:
                continue
            c = loop.c[number]
            new = b.block.update(
                loop.z[number], w.sigma[-1] - moved[at].dot(w.sigma[:-1]))
            number += 1
            moved_c = new - c
            elastic += float(moved_c.dot(moved_c))
            size += float(new.dot(new))
            if b.block.active is None:
                x[b.elastic] = new
            else:
                x[b.elastic] = 0.0
                x[b.elastic.start + b.block.active] = new
        memory.scale = max(memory.scale, size)
        if memory.floor < 0:
            memory.floor = self._floor(loop.y)
        if elastic <= memory.floor:
            elastic = 0.0
        if memory.scale > 0:
            elastic = sqrt(elastic / memory.scale)
        # not (a <= b) is true for a change that is not a number
        return elastic if not elastic <= change else change

    def _floor(self, y: FloatArray) -> float:
        """|du|^2 that follows from rounding the rigid coordinates: a position is known to eps |q|,
        so its acceleration to c2 eps |q|, which bends the bodies."""
        q = y[: self.n_rigid]
        total = 0.0
        for b, w in zip(self.bodies, self.work, strict=True):
            if b.block is not None:
                rows = w.sigma[: b.frame.rigid_size]
                total += sum(float(u.dot(u)) for u in (b.block.update(_ZERO, r) for r in rows))
        return total * (4 * EPS) ** 2 * max(1.0, float(q.dot(q)))

    def _worst(self, x: FloatArray, loop: _Loop) -> str:
        """The block whose last change was largest, or is not finite."""
        sizes, number = {}, 0
        for b in self.bodies:
            if b.block is None:
                sizes[f"{b.name}.rigid"] = _largest(loop.y[: self.n_rigid])
                continue
            now = x[b.elastic] if b.block.active is None else x[b.elastic][b.block.active]
            sizes[b.elastic_name] = _largest(now - loop.c[number])
            number += 1
        broken = [n for n, size in sizes.items() if not size < inf]
        return broken[0] if broken else max(sizes, key=lambda n: sizes[n])


_NONE, _ZERO = np.zeros(0), np.zeros(1)
EPS = float(np.finfo(np.float64).eps)
ROUND_OFF = 1e-10
"""A relative change that no longer shrinks is round-off when it is below this."""


def _largest(x: FloatArray) -> float:
    return float(np.abs(x).max(initial=0.0))
