"""Mechanics of a step: rigid coordinates, joint forces and all displacements together, by the loop
of newton_loop.py."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core import Amplitude, FloatArray, IntArray, Status, StepFormula, StepOutcome
from sparsemor.core.protocols.integrator import second_difference
from sparsemor.reducers.step.convergence_test import Tolerances
from sparsemor.reducers.step.frame_step import BodyStep
from sparsemor.reducers.step.newton_loop import Loop, StepEquations
from sparsemor.reducers.step.reduced_equations import Reduced
from sparsemor.reducers.step.step_memory import Memory


class StepUnknowns:
    """Unknowns at the end of a step: temperatures are final once they are solved for, those of the
    mechanics are the prediction until these are.

    d (n,): departure from the free motion (core/protocols/integrator.py), to which increments are
    added; remaining: largest estimated error that an iteration left (`StepOutcome`).
    """

    __slots__ = ("d", "remaining", "step")

    def __init__(self, step: StepFormula, d: FloatArray) -> None:
        self.step, self.d, self.remaining = step, d, 0.0

    def temperatures(
        self, at: slice | IntArray, local: bool = True
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Temperatures numbered `at` (k,) with their rates and second differences, which are zero
        without `local` terms to read them."""
        step, d = self.step, self.d[at]
        T, rate = step.free[at] + d, step.c1_first * d
        if not local or step.before is None:
            return T, rate, np.zeros(len(d))
        return T, rate, second_difference(step.before[at], T, rate, step.h)

    def add_temperatures(
        self, at: slice | IntArray, active: IntArray | None, d: FloatArray
    ) -> None:
        """Adds increments d of the active temperatures (None: all) among those numbered `at`, which
        are final."""
        if active is not None and isinstance(at, slice):
            at = at.start + active
        self.d[at] += d

    def drop_inactive_temperatures(self, at: slice, active: IntArray | None) -> None:
        """Sets the inactive coefficients of a thermal block to zero."""
        if active is not None:
            inactive = np.ones(at.stop - at.start, dtype=np.bool_)
            inactive[active] = False
            numbers = at.start + np.flatnonzero(inactive)
            self.d[numbers] = -self.step.free[numbers]

    def outcome(
        self, status: Status, iterations: int, block: str = "", detail: str = ""
    ) -> StepOutcome:
        """The unknowns and their rates as the solution of the step."""
        x, v, a = self.step.at(self.d, differences=False)
        return StepOutcome(x, status, iterations, block, detail, (v, a), self.remaining)


@dataclass(frozen=True, slots=True, eq=False)
class Mechanics:
    """Bodies and constraints of the mechanics of a step. n_rigid: number of rigid coordinates;
    algebraic: range of the multipliers; targets: (position among rigid coordinates and multipliers,
    prescribed value as a function of time) of the constraints; h: step, s.
    """

    bodies: tuple[BodyStep, ...]
    n_rigid: int
    algebraic: slice
    targets: tuple[tuple[int, Amplitude], ...]
    h: float

    @property
    def size(self) -> int:
        """Number of rigid coordinates and multipliers."""
        return int(self.n_rigid + self.algebraic.stop - self.algebraic.start)


class LoopMechanics:
    """Mechanics of a step, solved after its temperatures by the loop. equations: of the mechanics,
    for known temperatures."""

    def __init__(self, equations: StepEquations, tolerances: Tolerances) -> None:
        self.equations, self.tol = equations, tolerances
        self.loop = Loop(equations.layout, tolerances)

    def alone(self) -> Mapping[str, FloatArray]:
        """Reduced elastic block -> (s, 2 s): response of its active coefficients to changes of
        their r1 and r2 with all other unknowns fixed."""
        return {}

    def solve(
        self, step: StepFormula, now: StepUnknowns, memory: Memory
    ) -> tuple[Status, int, str, str]:
        """Solves a step in place from the prediction `now`; returns status, number of iterations,
        block of a failure, and details. memory.kept: Jacobian and magnitudes that the loop keeps
        over steps; its factorizations are counted in `memory`."""
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
    """Mechanics of a reduced model. whole: equations of the whole step, from which those of the
    mechanics alone are made. parts, of_parts: for storage in a file."""

    equations: Reduced

    def __init__(self, whole: Reduced, tolerances: Tolerances) -> None:
        super().__init__(whole.after_heat(), tolerances)
        self.whole = whole

    def parts(self) -> tuple[Any, ...]:
        return self.whole, self.tol

    @classmethod
    def of_parts(cls, *parts: Any) -> "ReducedMechanics":
        return cls(*parts)

    def alone(self) -> Mapping[str, FloatArray]:
        return self.whole.alone()
