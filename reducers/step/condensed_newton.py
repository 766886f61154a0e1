"""Modified Newton iteration for rigid coordinates, multipliers and elastic blocks of one step.

Unknowns are the increments from a prediction (elastic_block.py). The elastic blocks are eliminated
with their constant operator D, which leaves a small bordered system for rigid coordinates and
multipliers (Schur complement). The residual is exact; the Jacobian neglects terms quadratic in u
and is kept after a small change, so that the iteration converges linearly and fast. It ends when
the error estimated from two changes of this step is below the tolerance (acceptance.py).
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from math import inf, sqrt
from typing import Any

import numpy as np

from sparsemor.core import Amplitude, FloatArray, Status, StepFormula
from sparsemor.reducers.step.acceptance import (
    EPS,
    STALLED,
    Scales,
    Tolerances,
    largest_error,
    reference,
)
from sparsemor.reducers.step.anderson import Anderson
from sparsemor.reducers.step.blocks.elastic_block import ElasticBlock
from sparsemor.reducers.step.blocks.elastic_local import GROWN
from sparsemor.reducers.step.border.sparse import bordered_system
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.iteration_state import EliminationState, Workspace, rounded_off
from sparsemor.reducers.step.memory import Memory
from sparsemor.reducers.step.step_unknowns import StepUnknowns


class Mechanics:
    """Mechanical equations of one step for constant (c1, c2). Immutable: a step writes to the
    caller's `Workspace` only.

    The border unknowns of the bodies (pose of the frame and joint forces) are stacked; `system`
    maps the N rigid coordinates and multipliers of the model to them (border/system.py).
    """

    def __init__(
        self, bodies: Sequence[BodyStep], n_rigid: int, algebraic: slice,
        targets: Sequence[tuple[int, Amplitude]], tolerances: Tolerances,
    ) -> None:
        self.bodies, self.n_rigid, self.algebraic = tuple(bodies), n_rigid, algebraic
        self.local = _local(bodies)
        self.size = n_rigid + algebraic.stop - algebraic.start
        self.targets, self.tol = tuple(targets), tolerances
        self.system = bordered_system([b.to_border for b in bodies], self.size, n_rigid)
        self.origin = np.concatenate([np.zeros(0), *(b.origin for b in bodies)])
        edges = np.cumsum([0, *(b.frame.border for b in bodies)]).tolist()
        self.at = list(map(slice, edges, edges[1:]))
        self.positions = [_positions(b) for b in self.bodies]
        self.turning = np.zeros(n_rigid, dtype=np.bool_)
        for b, count in zip(self.bodies, self.positions, strict=True):
            own = b.to_border[count : b.frame.rigid_size, :n_rigid]
            self.turning |= own.any(axis=0)
        self.with_motion = [(slice(at.start, at.start + b.frame.rigid_size), b.guide)
                       for b, at in zip(bodies, self.at, strict=True) if b.guide is not None]

    def parts(self) -> tuple[Any, ...]:
        return self.bodies, self.n_rigid, self.algebraic, self.targets, self.tol

    @classmethod
    def of_parts(cls, *parts: Any) -> "Mechanics":
        return cls(*parts)

    def workspace(self) -> Workspace:
        """Working arrays for one run, or one thread."""
        return Workspace([b.frame for b in self.bodies], self.system)

    def with_blocks(self, blocks: Mapping[str, ElasticBlock]) -> "Mechanics":
        """These equations with some elastic blocks replaced, by name."""
        other = copy(self)
        other.bodies = tuple(
            replace(b, block=blocks.get(b.elastic_name, b.block)) for b in self.bodies)
        other.local = _local(other.bodies)
        return other

    def alone(self) -> Mapping[str, FloatArray]:
        """Reduced elastic block -> (k, 2 k): response of its coefficients to changes of their r1
        and r2 with all other unknowns fixed, where these equations have the blocks."""
        return {}

    def remember(self, x: FloatArray, d: FloatArray, step: StepFormula, memory: Memory) -> None:
        """Takes the magnitudes of an accepted step into account; these were, by `solve`."""

    def solve(
        self, step: StepFormula, now: StepUnknowns, run: Memory
    ) -> tuple[Status, int, str, str]:
        """Solves a step by iteration, in place from the prediction `now`; returns status, number of
        iterations, block of a failure, and details."""
        memory, work = run.scales, run.work
        loop = self._begin(step, now, memory)
        work.loop = loop
        last, change, slow = inf, inf, None
        before: list[float] | None = None
        mixed: FloatArray | None
        for iteration in range(1, self.tol.max_iterations + 1):
            if iteration > 1:
                self._displace(step, loop)
            mixed = None if slow is None else self._gather(loop)
            # a matrix that hardly changes is kept: the ratio of changes shows what that costs
            fresh = iteration == 1 or change > KEPT or change > SLOW * last
            last = change
            change = self._iterate(step, loop, memory, work, fresh)
            if not change < inf:
                return self._broken(iteration, loop)
            if change < 0:
                return Status.SINGULAR, iteration, "", "the border matrix is singular"
            error = largest_error(loop.changes, before)
            if error <= self.tol.remaining or (
                    change >= STALLED * last and rounded_off(self, loop, work)):
                now.remaining = max(now.remaining, error)
                self._move(now, loop, memory)
                return Status.DONE, iteration, "", ""
            if self.local and change > GROWN * last:
                break
            before = loop.changes
            if slow is None and iteration > 1 and change > SLOW * last:
                slow = Anderson()
            if slow is not None and mixed is not None:
                self._scatter(slow.mix(mixed, self._gather(loop), self._weights(memory)), loop)
                before = None  # the next change is no image of this one
        detail = f"last relative change {change:.1e} after {iteration} iterations"
        return Status.NOT_CONVERGED, iteration, self._worst(loop), detail

    def _broken(self, iteration: int, loop: EliminationState) -> tuple[Status, int, str, str]:
        """Status of an iterate that is not finite: an unconverged linear solver, or overflow."""
        for b, past in zip(self.bodies, loop.history, strict=True):
            if past is not None and past.failure is not None:
                return past.failure[0], iteration, b.elastic_name, past.failure[1]
        return Status.NOT_FINITE, iteration, self._worst(loop), ""

    def _gather(self, loop: EliminationState) -> FloatArray:
        """Increments of border and elastic unknowns in one vector."""
        return np.concatenate((loop.d, *loop.u))

    def _scatter(self, u: FloatArray, loop: EliminationState) -> None:
        sizes = np.cumsum([self.size, *(len(d) for d in loop.u)]).tolist()
        loop.d, *loop.u = np.split(u, sizes[:-1])

    def _weights(self, memory: Scales) -> FloatArray:
        """Weights that scale rigid coordinates and displacements to comparable size; zero for
        multipliers, which follow from these."""
        weights = [np.zeros(self.size)]
        weights[0][: self.n_rigid] = 1.0
        for b, scale in zip(self.bodies, memory.elastic, strict=True):
            active = 0 if b.block is None else (
                b.elastic.stop - b.elastic.start if b.block.active is None
                else len(b.block.active))
            weights.append(np.full(active, scale**-0.5 if scale > 0 else 0.0))
        return np.concatenate(weights)

    def _begin(self, step: StepFormula, now: StepUnknowns, memory: Scales) -> EliminationState:
        loop, nr = EliminationState(), self.n_rigid
        loop.history, loop.u = [], []
        for b in self.bodies:
            if b.block is None:
                loop.history.append(None)
                loop.u.append(_NONE)
                continue
            guess = now.prediction(b, b.block.active)
            past = b.block.begin(guess, step.c1, step.c2)
            past.local = now.local_forces(b, b.block, guess)
            loop.history.append(past)
            loop.u.append(np.zeros(len(past.u)))
        known = len(memory.elastic) > 0
        loop.reference = [self._reference(i, step.c2, memory) if known else 0.0
                          for i in range(len(self.bodies))]
        loop.changes, loop.dy = [0.0] * (len(self.bodies) + 1), _NONE
        loop.targets = np.zeros(self.size)
        for i, f in self.targets:
            loop.targets[i] = f(step.t)
        loop.predicted = np.concatenate((now.x[:nr], now.x[self.algebraic]))
        loop.d, loop.acceleration = np.zeros(self.size), now.a[:nr] / step.c2
        rates = self.system.stacked_rates
        loop.border = loop.now = (
            self.system.stacked(loop.predicted) + self.origin, rates(now.v[:nr]),
            rates(now.a[:nr]))
        for at, guide in self.with_motion:
            for values, part in zip(loop.border, guide.at(step.t), strict=True):
                values[at] += part
        loop.size = self._size(step, loop.predicted[:nr], memory)
        loop.distance = []
        for at, count in zip(self.at, self.positions, strict=True):
            R = loop.border[0][at.start : at.start + count]
            loop.distance.append(float(R.dot(R)))
        return loop

    def _reference(self, i: int, c2: float, memory: Scales) -> float:
        """Reference magnitude of changes of the displacements of body i."""
        return reference(
            sqrt(memory.elastic[i]), sqrt(memory.bending[i]), c2, self.tol.remaining)

    def _size(self, step: StepFormula, q: FloatArray, memory: Scales) -> float:
        """Reference magnitude of changes of the rigid coordinates."""
        size = max(1.0, sqrt(float(q.dot(q))))
        return reference(size, memory.acceleration, step.c2, self.tol.remaining)

    def _move(self, now: StepUnknowns, loop: EliminationState, memory: Scales) -> None:
        """Adds the increments of a solved step to its unknowns, and updates the reference magnitude
        of accelerations."""
        nr, d, c2 = self.n_rigid, now.d, now.step.c2
        d[:nr] += loop.d[:nr]
        d[self.algebraic] += loop.d[nr:]
        for i, (b, u) in enumerate(zip(self.bodies, loop.u, strict=True)):
            if b.block is None:
                continue
            now.move(b.elastic, b.block.active, u)
            own = d[b.elastic]
            memory.bending[i] = max(memory.bending[i], c2 * c2 * float(own.dot(own)))
        own = d[:nr]
        memory.acceleration = max(memory.acceleration, c2 * sqrt(float(own.dot(own))))

    def _displace(self, step: StepFormula, loop: EliminationState) -> None:
        """Border unknowns with rates, and products of the displacements, at the increments."""
        moved = self.system.stacked(loop.d)
        y, v, a = loop.border
        loop.now = y + moved, v + step.c1 * moved, a + step.c2 * moved
        for b, past, d in zip(self.bodies, loop.history, loop.u, strict=True):
            if b.block is not None and past is not None:
                b.block.move(d, past)

    def _iterate(
        self, step: StepFormula, loop: EliminationState, memory: Scales, work: Workspace,
        fresh: bool,
    ) -> float:
        """One Newton iteration; returns the largest relative change (-1: singular). fresh: False if
        frames may keep the derivatives of the iteration before."""
        c1, c2, t, (y, v, a) = step.c1, step.c2, step.t, loop.now
        for b, w, past, at, d, H in zip(self.bodies, work.frames, loop.history, self.at, loop.u,
                                        work.H.views, strict=True):
            w.fresh = fresh
            if b.block is None or past is None:
                b.frame.evaluate(y[at], v[at], a[at], c1, c2, _NONE_OF, _NONE, t, w)
                H[:] = w.border
            else:
                b.frame.evaluate(y[at], v[at], a[at], c1, c2, past.s, past.forms, t, w)
                # border minus tau D^-1 (elastic columns and residual): the Schur complement
                np.subtract(w.border, w.tau.dot(b.block.condensed(d, past, w)), H)
        return self._advance(loop, memory, work)

    def _advance(self, loop: EliminationState, memory: Scales, work: Workspace) -> float:
        nr = self.n_rigid
        system = self.system
        loop.matrix, r = system.assembled(work.H.values)
        dy = system.solved(loop.matrix, r - loop.targets)
        if dy is None:
            return -1.0
        loop.d = loop.d - dy
        d = dy[:nr]
        moved, loop.dy = system.stacked(dy), dy
        changes = [sqrt(d.dot(d)) / loop.size]
        if not memory.floor:
            memory.elastic, memory.floor = [0.0] * len(self.bodies), self._floors(work)
            memory.bending = memory.elastic[:]
        for i, (b, past, at) in enumerate(zip(self.bodies, loop.history, self.at, strict=True)):
            if b.block is None or past is None:
                changes.append(0.0)
                continue
            new = b.block.increment(past, moved[at])
            d, u = new - loop.u[i], past.u + new
            moved2, size = float(d.dot(d)), float(u.dot(u))
            if size > memory.elastic[i]:
                memory.elastic[i] = size
                loop.reference[i] = self._reference(i, past.c2, memory)
            scale = loop.reference[i]
            # a body that hardly bends is known to its own round-off, not to its own size
            if moved2 <= memory.floor[i] * loop.distance[i]:
                changes.append(0.0)
            else:  # first step, not a number
                changes.append(sqrt(moved2) / scale if scale > 0.0 and moved2 < inf else inf)
            loop.u[i] = new
        loop.changes = changes
        return max(changes)  # not a number if the first one is

    def _floors(self, work: Workspace) -> list[float]:
        """Round-off |du|^2 of each body's displacements for a position R of size 1: it is exact to
        eps |R|, so its acceleration to c2 eps |R|, and the inertia forces deform the bodies."""
        return [0.0 if b.block is None or not b.free else (4 * EPS) ** 2 * sum(
            float(u.dot(u)) for u in (b.block.response(r) for r in w.sigma[: b.frame.rigid_size]))
                for b, w in zip(self.bodies, work.frames, strict=True)]

    def _worst(self, loop: EliminationState) -> str:
        """Name of the block whose last change was largest, or is not finite."""
        nr = self.n_rigid
        q = np.concatenate([loop.predicted[:nr] + loop.d[:nr], [1.0]])
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
KEPT = 1e-5
"""Largest change after which the matrix of the iteration is kept."""
_NONE, _NONE_OF, _ZERO = np.zeros(0), np.zeros((3, 0)), np.zeros(1)


def _local(bodies: Sequence[BodyStep]) -> bool:
    """True if displacements of any body have local terms."""
    return any(made is not None and made.local is not None
               for b in bodies for made in (b.block, b.prescribed))


def _positions(body: BodyStep) -> int:
    """Number of coordinates of a body's position: the first of its rigid coordinates."""
    return min(3, body.frame.rigid_size - 1)


def _largest(x: FloatArray) -> float:
    return float(np.abs(x).max(initial=0.0))
