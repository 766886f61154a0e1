"""Modified Newton iteration for rigid coordinates, multipliers and elastic blocks of one step.

The elastic blocks are eliminated with their constant operator D, which leaves a small bordered
system for rigid coordinates and multipliers (Schur complement). The residual is exact; the Jacobian
neglects terms quadratic in u, so that the iteration converges linearly and fast. It ends when the
error estimated from two changes of this step is below the tolerance (acceptance.py).
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from math import inf, sqrt

import numpy as np
from scipy.linalg.lapack import dgesv

from sparsemor.core import Amplitude, FloatArray, Status, StepFormula
from sparsemor.reducers.step.acceptance import (
    EPS,
    STALLED,
    Scales,
    Tolerances,
    largest_error,
)
from sparsemor.reducers.step.anderson import Anderson
from sparsemor.reducers.step.elastic_block import ElasticBlock
from sparsemor.reducers.step.elastic_local import GROWN, StepForces
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.iteration_state import Loop, Workspace, rounded_off


class Mechanics:
    """Mechanical equations of one step for constant (c1, c2). Immutable: a step writes to the
    caller's `Workspace` only.

    The border unknowns of the bodies (pose of the frame and joint forces) are stacked: `map` (sum
    b, N) maps the N rigid coordinates and multipliers of the model to them.
    """

    def __init__(
        self, bodies: Sequence[BodyStep], n_rigid: int, algebraic: slice,
        targets: Sequence[tuple[int, Amplitude]], tolerances: Tolerances,
    ) -> None:
        self.bodies, self.n_rigid, self.algebraic = tuple(bodies), n_rigid, algebraic
        self.size = n_rigid + algebraic.stop - algebraic.start
        self.targets, self.tol = tuple(targets), tolerances
        self.map = np.concatenate([np.zeros((0, self.size)), *(b.to_border for b in bodies)])
        self.origin = np.concatenate([np.zeros(0), *(b.origin for b in bodies)])
        edges = np.cumsum([0, *(b.frame.border for b in bodies)]).tolist()
        self.at = list(map(slice, edges, edges[1:]))
        self.with_motion = [(slice(at.start, at.start + b.frame.rigid_size), b.guide)
                       for b, at in zip(bodies, self.at, strict=True) if b.guide is not None]

    def workspace(self) -> Workspace:
        """Working arrays for one run, or one thread."""
        return Workspace([b.frame for b in self.bodies])

    @property
    def elastic(self) -> slice:
        """Range of the elastic unknowns of all bodies in the vector of the step; contiguous."""
        at = [b.elastic for b in self.bodies if b.block is not None] or [slice(0, 0)]
        return slice(at[0].start, at[-1].stop)

    def with_blocks(self, blocks: Mapping[str, ElasticBlock]) -> "Mechanics":
        """These equations with some elastic blocks replaced, by name."""
        other = copy(self)
        other.bodies = tuple(
            replace(b, block=blocks.get(b.elastic_name, b.block)) for b in self.bodies)
        return other

    def solve(
        self, step: StepFormula, x: FloatArray, memory: Scales, work: Workspace
    ) -> tuple[Status, int, str, str]:
        """Solves a step by iteration, in place from the guess x; returns status, number of
        iterations, block of a failure, and details."""
        loop, nr = self._begin(step, x, memory), self.n_rigid
        work.loop = loop
        last, slow = inf, None
        local = any(past is not None and past.local is not None for past in loop.history)
        before: list[float] | None = None
        mixed: FloatArray | None
        for iteration in range(1, self.tol.max_iterations + 1):
            mixed = None if slow is None else self._gather(x, loop)
            change = self._iterate(step, x, loop, memory, work)
            if not change < inf:
                return self._broken(iteration, loop)
            if change < 0:
                return Status.SINGULAR, iteration, "", "the border matrix is singular"
            if largest_error(loop.changes, before) <= self.tol.remaining or (
                    change >= STALLED * last and rounded_off(self, step, loop, memory, work)):
                x[:nr], x[self.algebraic] = loop.y[:nr], loop.y[nr:]
                self._accelerations(step, loop, memory)
                return Status.DONE, iteration, "", ""
            if local and change > GROWN * last:
                break
            before = loop.changes
            if slow is None and iteration > 1 and change > SLOW * last:
                slow = Anderson()
            if slow is not None and mixed is not None:
                self._scatter(slow.mix(mixed, self._gather(x, loop), self._weights(memory)),
                              x, loop)
                before = None  # the next change is no image of this one
            last = change
        detail = f"last relative change {change:.1e} after {iteration} iterations"
        return Status.NOT_CONVERGED, iteration, self._worst(loop), detail

    def _broken(self, iteration: int, loop: Loop) -> tuple[Status, int, str, str]:
        """Status of an iterate that is not finite: an unconverged linear solver, or overflow."""
        for b, past in zip(self.bodies, loop.history, strict=True):
            if past is not None and past.failure is not None:
                return past.failure[0], iteration, b.elastic_name, past.failure[1]
        return Status.NOT_FINITE, iteration, self._worst(loop), ""

    def _gather(self, x: FloatArray, loop: Loop) -> FloatArray:
        """Border and elastic unknowns in one vector."""
        return np.concatenate((loop.y, x[self.elastic]))

    def _scatter(self, u: FloatArray, x: FloatArray, loop: Loop) -> None:
        loop.y, x[self.elastic] = u[: self.size], u[self.size :]

    def _weights(self, memory: Scales) -> FloatArray:
        """Weights that scale rigid coordinates and displacements to comparable size; zero for
        multipliers, which follow from these."""
        weights = np.zeros(self.size + self.elastic.stop - self.elastic.start)
        weights[: self.n_rigid] = 1.0
        for b, scale in zip(self.bodies, memory.elastic, strict=True):
            if b.block is not None and scale > 0:
                first = self.size + b.elastic.start - self.elastic.start
                weights[first : first + b.elastic.stop - b.elastic.start] = scale**-0.5
        return weights

    def _begin(self, step: StepFormula, x: FloatArray, memory: Scales) -> Loop:
        loop, r1, r2, nr = Loop(), step.r1, step.r2, self.n_rigid
        loop.history = [
            None if b.block is None else
            b.block.begin(r1[b.elastic], r2[b.elastic], x[b.thermal], step.t) for b in self.bodies]
        for b, past in zip(self.bodies, loop.history, strict=True):
            if b.block is not None and past is not None and b.block.local is not None:
                past.local = StepForces.of(b.block.local, step, b.elastic, b.thermal, x)
        loop.c, loop.z = [_NONE] * len(self.bodies), [_NONE] * len(self.bodies)
        loop.sigma = [_NONE] * len(self.bodies)
        loop.changes, loop.dy = [0.0] * (len(self.bodies) + 1), _NONE
        loop.targets = np.zeros(self.size)
        for i, f in self.targets:
            loop.targets[i] = f(step.t)
        rigid = self.map[:, :nr]
        loop.velocity, loop.acceleration = rigid.dot(r1[:nr]), rigid.dot(r2[:nr])
        loop.y, loop.origin = np.concatenate((x[:nr], x[self.algebraic])), self.origin
        if self.with_motion:
            loop.origin = self.origin.copy()
        for at, guide in self.with_motion:
            pose, rate, acceleration = guide.at(step.t)
            loop.origin[at] += pose
            loop.velocity[at] += rate
            loop.acceleration[at] += acceleration
        loop.size = self._size(step, loop.y[:nr], memory)
        return loop

    def _size(self, step: StepFormula, q: FloatArray, memory: Scales) -> float:
        """Reference magnitude of changes of the rigid coordinates: |q|, or less where an error of
        `remaining` |q| would dominate the accelerations, but not below round-off."""
        size = max(1.0, sqrt(float(q.dot(q))))
        least = max(ACCELERATION_ERROR * memory.acceleration / step.c2,
                    4 * EPS * size / self.tol.remaining)
        return min(size, least)

    def _accelerations(self, step: StepFormula, loop: Loop, memory: Scales) -> None:
        """Updates the reference magnitude of accelerations by those of the solved step."""
        nr = self.n_rigid
        a = step.c2 * loop.y[:nr] + step.r2[:nr]
        size = sqrt(float(a.dot(a)))
        if size > memory.acceleration:
            memory.acceleration = size

    def _iterate(
        self, step: StepFormula, x: FloatArray, loop: Loop, memory: Scales, work: Workspace
    ) -> float:
        """One Newton iteration; returns the largest relative change (-1: singular)."""
        c1, c2, H, rows = step.c1, step.c2, work.H, work.rows
        moving = self.map.dot(loop.y)
        v, a = c1 * moving + loop.velocity, c2 * moving + loop.acceleration
        y = moving + loop.origin
        for i, (b, w, past, at) in enumerate(
                zip(self.bodies, work.frames, loop.history, self.at, strict=True)):
            if b.block is None or past is None:
                b.frame.evaluate(y[at], v[at], a[at], c1, c2, _NONE, _NONE, _NONE, _NONE, _NONE,
                                 step.t, w)
                H[at, at], rows[at] = w.border[:, :-1], w.border[:, -1]
                continue
            c = x[b.elastic] if b.block.active is None else x[b.elastic][b.block.active]
            of = b.block.functionals(c, past)
            b.frame.evaluate(y[at], v[at], a[at], c1, c2, of.s, past.s1, past.s2, of.form,
                             of.forms, step.t, w)
            z, Pz = b.block.combine(of, past, w.coefficients, c, w.sigma[-1])
            # border minus tau D^-1 (elastic columns and residual): the Schur complement
            Gs = b.block.G.dot(w.sigma.T)
            Gs[:, -1] += of.s + Pz
            reduced = w.border - w.tau.dot(Gs)
            H[at, at], rows[at] = reduced[:, :-1], reduced[:, -1]
            loop.c[i], loop.z[i] = c, z
        return self._advance(x, loop, memory, work)

    def _advance(self, x: FloatArray, loop: Loop, memory: Scales, work: Workspace) -> float:
        nr = self.n_rigid
        loop.matrix = B = self.map.T.dot(work.H.dot(self.map))
        dy, info = dgesv(B, work.rows.dot(self.map) - loop.targets, 1, 1)[2:]
        if info > 0:
            return -1.0
        loop.y = loop.y - dy
        d, q = dy[:nr], loop.y[:nr]
        moved, loop.dy = self.map.dot(dy), dy
        changes = [sqrt(d.dot(d)) / loop.size]
        if not memory.floor:
            memory.elastic, memory.floor = [0.0] * len(self.bodies), self._floors(work)
        noise = max(1.0, float(q.dot(q)))
        for i, (b, w, at) in enumerate(zip(self.bodies, work.frames, self.at, strict=True)):
            if b.block is None:
                changes.append(0.0)
                continue
            loop.sigma[i] = w.sigma[-1] - moved[at].dot(w.sigma[:-1])
            new = b.block.update(loop.z[i], loop.sigma[i])
            d = new - loop.c[i]
            moved2, size = float(d.dot(d)), float(new.dot(new))
            scale = memory.elastic[i]
            if size > scale:
                scale = memory.elastic[i] = size
            # a body that hardly bends is known to its own round-off, not to its own size
            if moved2 <= memory.floor[i] * noise:
                changes.append(0.0)
            else:  # first step, not a number
                changes.append(sqrt(moved2 / scale) if scale > 0.0 and moved2 < inf else inf)
            if b.block.active is None:
                x[b.elastic] = new
            else:
                x[b.elastic] = 0.0
                x[b.elastic.start + b.block.active] = new
        loop.changes = changes
        change = max(changes)
        return change if all(c < inf for c in changes) else inf

    def _floors(self, work: Workspace) -> list[float]:
        """Round-off |du|^2 of each body's displacements for rigid coordinates of size 1: a position
        is exact to eps |q|, so its acceleration to c2 eps |q|, and the inertia forces deform the
        bodies."""
        return [0.0 if b.block is None or not b.free else (4 * EPS) ** 2 * sum(
            float(u.dot(u)) for u in (b.block.update(_ZERO, r) for r in
                                      w.sigma[: b.frame.rigid_size]))
                for b, w in zip(self.bodies, work.frames, strict=True)]

    def _worst(self, loop: Loop) -> str:
        """Name of the block whose last change was largest, or is not finite."""
        q = np.concatenate([loop.y[: self.n_rigid], [1.0]])
        sizes = {}
        for b, moved in zip(self.bodies, loop.changes[1:], strict=True):
            d = b.to_border[: b.frame.rigid_size] @ loop.dy if len(loop.dy) else _ZERO
            if b.rigid_name:
                sizes[b.rigid_name] = sqrt(float(d.dot(d))) / _largest(q)
            if b.block is not None:
                sizes[b.elastic_name] = moved
        broken = [n for n, size in sizes.items() if not size < inf]
        return broken[0] if broken else max(sizes, key=lambda n: sizes[n], default="")


SLOW = 0.2
"""Ratio of consecutive changes above which the iteration is accelerated."""
_NONE, _ZERO = np.zeros(0), np.zeros(1)
ACCELERATION_ERROR = 1e5
"""Tolerance of the relative error of accelerations, as a multiple of `remaining`."""


def _largest(x: FloatArray) -> float:
    return float(np.abs(x).max(initial=0.0))
