"""Mechanics of a step: rigid coordinates, joint forces and all displacements together, by the loop
of loop.py."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sparsemor.core import Amplitude, FloatArray, Status, StepFormula
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.condensed_newton import Mechanics
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.iteration_state import Workspace
from sparsemor.reducers.step.loop import Loop, StepEquations
from sparsemor.reducers.step.memory import Memory
from sparsemor.reducers.step.reduced import Reduced
from sparsemor.reducers.step.step_unknowns import StepUnknowns


class LoopMechanics(Mechanics):
    """Mechanics of a step, solved after its temperatures by the loop. equations: of the mechanics,
    for known temperatures."""

    def __init__(
        self, bodies: Sequence[BodyStep], n_rigid: int, algebraic: slice,
        targets: Sequence[tuple[int, Amplitude]], tolerances: Tolerances, equations: StepEquations,
    ) -> None:
        super().__init__(bodies, n_rigid, algebraic, targets, tolerances)
        self.equations, self.loop = equations, Loop(equations.layout, tolerances)

    def workspace(self) -> Workspace:
        return Workspace((), None, self.equations.working())

    def solve(
        self, step: StepFormula, now: StepUnknowns, memory: Memory
    ) -> tuple[Status, int, str, str]:
        equations = memory.work.equations
        assert equations is not None
        equations.begin(step, now.d)
        ended = self.loop.solve(equations, step, now.d, memory.kept, memory.newest)
        memory.factorizations += memory.kept.factorizations
        memory.kept.factorizations = 0
        now.d = ended.d
        now.remaining = max(now.remaining, ended.remaining if ended.status.ok else 0.0)
        return ended.status, ended.iterations, ended.block, ended.detail

    def remember(self, x: FloatArray, d: FloatArray, step: StepFormula, memory: Memory) -> None:
        self.loop.remember(x, d, step, memory.kept)


class ReducedMechanics(LoopMechanics):
    """Mechanics of a reduced model. whole: equations of the whole step."""

    equations: Reduced

    def __init__(
        self, bodies: Sequence[BodyStep], n_rigid: int, algebraic: slice,
        targets: Sequence[tuple[int, Amplitude]], tolerances: Tolerances, whole: Reduced,
    ) -> None:
        super().__init__(bodies, n_rigid, algebraic, targets, tolerances, whole.after_heat())
        self.whole = whole

    def parts(self) -> tuple[Any, ...]:
        return (*super().parts(), self.whole)

    def alone(self) -> Mapping[str, FloatArray]:
        return {b.step.elastic_name: -np.hstack([b.tested.damping, b.tested.mass])
                for b in self.whole.bodies if b.tested is not None}
