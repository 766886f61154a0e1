"""Newton's method with the exact Jacobian for a whole step, where a cheaper iteration fails.

The bordered iteration keeps its operators constant; the contribution of a soft body's large
displacements to the Jacobian may prevent convergence. Such a step is solved for all unknowns
together by the iteration of iteration.py. Its equations are assembled when they are first needed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sparsemor.core import FloatArray, StepFormula, StepOutcome
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.newton.equations import Equations
from sparsemor.reducers.step.newton.iteration import solve
from sparsemor.reducers.step.newton.memory import NewtonMemory
from sparsemor.reducers.step.newton.response import linear_response
from sparsemor.reducers.step.predictor import Past, block_starts

STEPS = 10
"""Number of steps after one that needed the exact Jacobian before the cheaper iteration is tried
again."""


@dataclass(frozen=True, slots=True, eq=False)
class Assembled:
    """Equations that are assembled already."""

    equations: Equations

    def __call__(self) -> Equations:
        return self.equations


@dataclass(frozen=True, eq=False)
class FullNewton:
    """Newton's method for the whole step. make: function that assembles the equations."""

    make: Callable[[], Equations]
    tolerances: Tolerances

    @cached_property
    def equations(self) -> Equations:
        return self.make()

    def solve(self, step: StepFormula, past: Past) -> StepOutcome:
        """Solves a step from the extrapolation of past states, and if that fails from the newest
        one."""
        outcome = self._solved(step, step.free + past.guess(step), past)
        if outcome.status.ok:
            return outcome
        second = self._solved(step, past.newest, past)
        return replace(second, iterations=outcome.iterations + second.iterations)

    def response(self, step: StepFormula, x: FloatArray) -> FloatArray:
        """Linear response (n, 2 n) of the solution x of a step to changes of [r1; r2]."""
        return linear_response(self.equations, step, x)

    def _solved(
        self, step: StepFormula, guess: FloatArray, past: Past
    ) -> StepOutcome:
        layout = self.equations.layout
        memory = NewtonMemory.of(guess, 1, block_starts(layout), self.equations.buffers)
        sizes = np.abs(past.ring.rows[:, : past.n]).max(axis=0)
        memory.top = np.array([sizes[layout[b.name]].max(initial=0.0) for b in layout])
        return solve(self.equations.of_run(memory), step, memory, self.tolerances)
