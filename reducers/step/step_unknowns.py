"""Unknowns of one step with their rates, changed together by increments."""

import numpy as np

from sparsemor.core import FloatArray, IntArray, Status, StepFormula, StepOutcome


class StepUnknowns:
    """Unknowns x and rates v, a (n,) at the end of a step: those of the prediction until `outcome`,
    which adds all increments at once; temperatures are changed as they are solved for.

    d (n,): departure from the free motion (core/protocols/integrator.py), to which increments are
    added; remaining: largest estimated error that an iteration left (`StepOutcome`).
    """

    __slots__ = ("a", "d", "remaining", "step", "v", "x")

    def __init__(self, step: StepFormula, d: FloatArray) -> None:
        self.step, self.d, self.remaining = step, d, 0.0
        self.x, self.v, self.a = step.at(d)

    def add_temperatures(
        self, at: slice | IntArray, active: IntArray | None, d: FloatArray
    ) -> None:
        """Adds increments d of the active temperatures (None: all) among those numbered `at`, which
        are final."""
        if active is not None and isinstance(at, slice):
            at = at.start + active
        self.d[at] += d
        self.x[at] += d
        self.v[at] += self.step.c1_first * d
        self.a[at] += self.step.c2_first * d

    def drop_inactive_temperatures(self, at: slice, active: IntArray | None) -> None:
        """Sets the inactive coefficients of a thermal block to zero."""
        if active is not None:
            inactive = np.ones(at.stop - at.start, dtype=np.bool_)
            inactive[active] = False
            numbers = at.start + np.flatnonzero(inactive)
            self.add_temperatures(numbers, None, -self.x[numbers])
            self.x[numbers] = 0.0

    def outcome(
        self, status: Status, iterations: int, block: str = "", detail: str = ""
    ) -> StepOutcome:
        """The unknowns and their rates as the solution of the step."""
        x, v, a = self.step.at(self.d)
        return StepOutcome(x, status, iterations, block, detail, (v, a), self.remaining)
