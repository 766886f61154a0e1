"""Mechanics of a step: rigid coordinates, joint forces and all displacements together, by the loop
of newton_loop.py."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sparsemor.core import Amplitude, FloatArray, Status, StepFormula
from sparsemor.reducers.step.acceptance import Tolerances
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.memory import Memory
from sparsemor.reducers.step.newton_loop import Loop, StepEquations
from sparsemor.reducers.step.reduced import Reduced
from sparsemor.reducers.step.step_unknowns import StepUnknowns


class Mechanics:
    """Bodies and constraints of the mechanics of a step. targets: prescribed values of the
    constraints; size: number of rigid coordinates and multipliers; positions: number of coordinates
    of each body's position, the first of its rigid ones."""

    def __init__(
        self, bodies: Sequence[BodyStep], n_rigid: int, algebraic: slice,
        targets: Sequence[tuple[int, Amplitude]], tolerances: Tolerances,
    ) -> None:
        self.bodies, self.n_rigid, self.algebraic = tuple(bodies), n_rigid, algebraic
        self.size = n_rigid + algebraic.stop - algebraic.start
        self.targets, self.tol = tuple(targets), tolerances
        self.positions = [min(3, b.frame.rigid_size - 1) for b in self.bodies]

    def parts(self) -> tuple[Any, ...]:
        return self.bodies, self.n_rigid, self.algebraic, self.targets, self.tol

    @classmethod
    def of_parts(cls, *parts: Any) -> "Mechanics":
        return cls(*parts)


class LoopMechanics(Mechanics):
    """Mechanics of a step, solved after its temperatures by the loop. equations: of the mechanics,
    for known temperatures."""

    def __init__(
        self, bodies: Sequence[BodyStep], n_rigid: int, algebraic: slice,
        targets: Sequence[tuple[int, Amplitude]], tolerances: Tolerances, equations: StepEquations,
    ) -> None:
        super().__init__(bodies, n_rigid, algebraic, targets, tolerances)
        self.equations, self.loop = equations, Loop(equations.layout, tolerances)

    def alone(self) -> Mapping[str, FloatArray]:
        """Reduced elastic block -> (s, 2 s): response of its active coefficients to changes of
        their r1 and r2 with all other unknowns fixed."""
        return {}

    def solve(
        self, step: StepFormula, now: StepUnknowns, memory: Memory
    ) -> tuple[Status, int, str, str]:
        """Solves a step in place from the prediction `now`; returns status, number of iterations,
        block of a failure, and details."""
        equations = memory.work.of(self.equations)
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
