"""Mechanical step where no rigid coordinate and no joint force is unknown.

Frames are then prescribed or at rest and the bodies decouple: each elastic block is a separate
linear problem. Its frame is evaluated once a step. The terms of the frame's rotation are small
relative to the constant operator and are iterated. Where the contraction factor has a proved bound
below 1/2, the error follows from the bound and the last change; otherwise it is estimated by two
changes of this step (acceptance.py).
"""

from math import inf, sqrt

import numpy as np

from sparsemor.core import FloatArray, Status, StepFormula
from sparsemor.reducers.step.acceptance import (
    LEAST,
    MARGIN,
    STALLED,
    TRUSTED,
    Scales,
    estimated_error,
)
from sparsemor.reducers.step.anderson import Anderson
from sparsemor.reducers.step.blocks.elastic_local import GROWN
from sparsemor.reducers.step.blocks.prescribed_frame_block import Past, PrescribedBlock
from sparsemor.reducers.step.condensed_newton import SLOW, Mechanics
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.iteration_state import EliminationState
from sparsemor.reducers.step.memory import Memory
from sparsemor.reducers.step.step_unknowns import StepUnknowns

NONE = np.zeros(0)


class PrescribedFrames(Mechanics):
    """Mechanical equations with prescribed frames, solved one body after the other."""

    def solve(
        self, step: StepFormula, now: StepUnknowns, run: Memory
    ) -> tuple[Status, int, str, str]:
        """Solves a step in place from the prediction `now`; returns status, number of iterations,
        block of a failure, and details."""
        memory, work = run.scales, run.work
        work.loop = loop = EliminationState()
        loop.history, loop.dy = [None] * len(self.bodies), NONE
        loop.predicted = loop.d = NONE
        if not memory.elastic:
            memory.elastic, memory.floor = [0.0] * len(self.bodies), [0.0] * len(self.bodies)
            memory.bending = memory.elastic[:]
        most = 1
        for i, (b, w) in enumerate(zip(self.bodies, work.frames, strict=True)):
            if b.prescribed is None or b.table is None:  # a rigid body: carried along
                continue
            table, g = b.table.at(step.t), len(w.coefficients) - 1
            w.coefficients[:g], w.sigma[-1] = table[:g], table[g : g + w.sigma.shape[1]]
            at = now.prediction(b, b.prescribed.active)
            past = b.prescribed.begin(at, step.c1, step.c2, table)
            past.local = now.local_forces(b, b.prescribed, at)
            loop.history[i] = past
            status, n, detail = self._body(i, b, b.prescribed, past, now, memory)
            most = max(most, n)
            if not status.ok:
                return status, n, b.elastic_name, detail
        return Status.DONE, most, "", ""

    def _body(
        self, i: int, b: BodyStep, block: PrescribedBlock, past: Past, now: StepUnknowns,
        memory: Scales,
    ) -> tuple[Status, int, str]:
        d = np.zeros(len(past.u))
        bound, last, slow, before = block.contraction(past), inf, None, inf
        for iteration in range(1, self.tol.max_iterations + 1):
            new = block.improve(d, past)
            if bound == 0.0 and past.failure is None:  # nothing turns: that was all
                now.move(b.elastic, block.active, new)
                return Status.DONE, iteration, ""
            change = _change(new, d, past.u, memory.elastic, i)
            if not change < inf:
                status, detail = past.failure or (Status.NOT_FINITE, "")
                return status, iteration, detail
            if past.local is not None and change > GROWN * last:
                break
            proved = block.proved and block.local is None
            error = self._error(change, before, bound, proved)
            if error <= self.tol.remaining or (
                    change >= STALLED * last and _rounded(change, d, block, past, memory, i)):
                now.remaining = max(now.remaining, error)
                now.move(b.elastic, block.active, new)
                return Status.DONE, iteration, ""
            before = change
            if slow is None and change > SLOW * last:
                slow = Anderson()
            if slow is None:
                d = new
            else:
                d, before = slow.mix(d, new, np.ones(len(d))), inf
            last = change
        detail = f"last relative change {last:.1e} after {iteration} iterations"
        return Status.NOT_CONVERGED, iteration, detail

    def _error(self, change: float, before: float, bound: float, proved: bool) -> float:
        """Estimated error after this change. A proved bound of the contraction factor also holds
        after accelerated changes; an estimated one is a lower bound of the measured ratio of
        changes."""
        if proved and bound < TRUSTED:
            return change * bound / (1.0 - bound)
        return estimated_error(change, before, LEAST if proved else max(bound, LEAST))


def _rounded(
    change: float, d: FloatArray, block: PrescribedBlock, past: Past, memory: Scales, i: int
) -> bool:
    """True if a change that no longer decreases is round-off."""
    return change * sqrt(memory.elastic[i]) <= MARGIN * block.noise(d, past)


def _change(new: FloatArray, d: FloatArray, u0: FloatArray, scales: list[float], i: int) -> float:
    """Change |new - d| of the increment relative to the largest |u| = |u0 + new| of body i so far,
    which is updated in `scales`."""
    change, u = new - d, u0 + new
    moved2, size = float(change.dot(change)), float(u.dot(u))
    if not size < inf:
        return inf
    scales[i] = max(scales[i], size)
    if scales[i] == 0.0:
        return 0.0 if moved2 == 0.0 else inf
    return sqrt(moved2 / scales[i])
