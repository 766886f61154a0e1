"""Unknowns of one step with their rates, changed together by increments."""

import numpy as np

from sparsemor.core import FloatArray, IntArray, Status, StepFormula, StepOutcome
from sparsemor.reducers.step.elastic_block import DisplacementBlock
from sparsemor.reducers.step.elastic_local import StepForces
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.predictor import Prediction


class StepUnknowns:
    """Unknowns x and rates v, a (n,) at the end of a step, consistent with its formula: an
    increment d of unknowns changes v by c1 d and a by c2 d."""

    __slots__ = ("a", "step", "v", "x")

    def __init__(self, step: StepFormula, d: FloatArray) -> None:
        """d (n,): departure from the free motion."""
        self.step = step
        self.x, self.v, self.a = step.at(d)

    def only(self, at: slice, active: IntArray | None, second: bool) -> None:
        """Sets the inactive unknowns of a block to zero."""
        if active is None:
            return
        out = np.ones(at.stop - at.start, dtype=np.bool_)
        out[active] = False
        idle = at.start + np.flatnonzero(out)
        self._add(idle, -self.x[idle], second)
        self.x[idle] = 0.0

    def prediction(self, body: BodyStep, active: IntArray | None) -> Prediction:
        """Predicted displacements of a body; inactive atoms have the coefficient zero."""
        at = body.elastic
        self.only(at, active, True)
        return Prediction(
            self.x[at].copy(), self.v[at].copy(), self.a[at].copy(), self.x[body.thermal],
            self.step.t)

    def local_forces(
        self, body: BodyStep, block: DisplacementBlock, at: Prediction
    ) -> StepForces | None:
        """Local terms of a body's displacements in this step, its temperatures being final."""
        if block.local is None:
            return None
        return StepForces(block.local, at, self.v[body.thermal], self.step.c1, self.step.c2,
                          block.active)

    def move(
        self, at: slice | IntArray, active: IntArray | None, d: FloatArray, second: bool = True
    ) -> None:
        """Adds the increment d of the active unknowns (None: all) among those numbered `at`."""
        if active is not None and isinstance(at, slice):
            at = at.start + active
        self._add(at, d, second)

    def outcome(
        self, status: Status, iterations: int, block: str = "", detail: str = ""
    ) -> StepOutcome:
        """The unknowns and their rates as the solution of the step."""
        return StepOutcome(self.x, status, iterations, block, detail, (self.v, self.a))

    def _add(self, at: slice | IntArray, d: FloatArray, second: bool) -> None:
        self.x[at] += d
        if second:
            self.v[at] += self.step.c1 * d
            self.a[at] += self.step.c2 * d
        else:
            self.v[at] += self.step.c1_first * d
