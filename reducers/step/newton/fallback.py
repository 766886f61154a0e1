"""A whole step by Newton's method with the exact Jacobian, where a cheaper iteration fails.

The bordered iteration keeps its operators constant; what a soft body's large displacements add to
the Jacobian may keep it from converging. Such a step is solved with all unknowns together, by the
equations and the search of iteration.py, which are assembled when the first step needs them.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from sparsemor.core import FloatArray, StepFormula, StepOutcome
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.newton.equations import Equations
from sparsemor.reducers.step.newton.iteration import solve
from sparsemor.reducers.step.newton.memory import NewtonMemory
from sparsemor.reducers.step.predictor import Ring

STEPS = 10
"""Steps that follow one which needed the exact Jacobian, before the cheaper iteration is tried
again."""


class FullNewton:
    """Newton's method for the whole step. make: assembles the equations."""

    def __init__(self, make: Callable[[], Equations], tolerances: Tolerances) -> None:
        self.make, self.tolerances = make, tolerances

    @cached_property
    def equations(self) -> Equations:
        return self.make()

    def solve(self, step: StepFormula, guess: FloatArray, past: Ring) -> StepOutcome:
        """From a guess (n,), and where that leads nowhere from the newest state of `past`."""
        outcome = self._solved(step, guess, past)
        if outcome.status.ok:
            return outcome
        second = self._solved(step, past.rows[past.newest], past)
        spent = outcome.iterations + second.iterations
        return StepOutcome(second.x, second.status, spent, second.block, second.detail)

    def _solved(
        self, step: StepFormula, guess: FloatArray, past: Ring
    ) -> StepOutcome:
        layout = self.equations.layout
        memory = NewtonMemory.of(guess, 1, len(layout.blocks), self.equations.buffers)
        sizes = np.abs(past.rows).max(axis=0)
        memory.top = np.array([sizes[layout[b.name]].max(initial=0.0) for b in layout])
        return solve(self.equations.of_run(memory), step, memory, self.tolerances)
