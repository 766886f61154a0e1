"""Screening of the atom selection in elastic blocks: does an exchange of atoms reduce the residual?

The test is made before the sparse solver is run and replaces it where its result is certain. The
rows are linear once rigid coordinates and multipliers are condensed (condensed_rows.py). The
condensed matrices change slowly; they are recomputed where a decision is close to its threshold,
and after a time that is estimated from their measured rate of change.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core import (
    BoolArray,
    FloatArray,
    GramError,
    Group,
    Layout,
    Quadratic,
    ScreensSupport,
    StepFormula,
)
from sparsemor.reducers.sparse.condensed_rows import Constants, Eliminated
from sparsemor.reducers.sparse.sampled_block import SampledElastic, SampledHeat
from sparsemor.reducers.sparse.sampled_residual import SampledBody
from sparsemor.reducers.sparse.screen_rows import Together, joined
from sparsemor.reducers.sparse.thermal_screen import HeatScreen
from sparsemor.reducers.step.condensed_newton import Mechanics
from sparsemor.reducers.step.iteration_state import Workspace
from sparsemor.reducers.step.solver import Stepper

ROUGH = GramError(3e-3, 1e-7)
"""Error bounds of two simplifications: infinitely stiff border rows, and no frame-rotation terms in
B. Measured for the packaged scene: 1e-3 and 5e-9. Close decisions are repeated without either."""
AGED = GramError(5e-2, 1e-6)
"""Additional error bounds for condensed matrices of an earlier step."""
EXACT = GramError(1e-6, 1e-12)
"""Error bounds without the two simplifications."""
CARE, GROWTH, TINY = 3.0, 2.0, 1e-300
"""Safety factor of the measured rate of change of the condensed matrices, largest growth of the
time for which they are kept, and a number that avoids division by zero."""
OLDEST = 50
"""Number of steps after which the condensed matrices are recomputed in any case: rates of change
measured over some steps do not bound the error after hundreds (6 % instead of 2 % after 524 steps
of a pendulum)."""
IDLE, LONGEST = 32, 1024
"""Number of steps without a new measurement where the matrices would not stay valid for one step;
doubled each time, up to the second number."""


class ElasticScreen:
    """Screening of all elastic blocks with atom selection in one least-squares problem."""

    def __init__(
        self, mechanics: Mechanics, elastic: Mapping[str, SampledElastic], layout: Layout,
        solver: ScreensSupport,
    ) -> None:
        self.bodies = [SampledBody(i, elastic[b.elastic_name])
                       for i, b in enumerate(mechanics.bodies) if b.elastic_name in elastic]
        groups: list[Group] = []
        for s in self.bodies:
            start = groups[-1].stop if groups else 0
            groups.append(Group(s.name, start, start + s.k, s.budget))
        self.groups, self.together = tuple(groups), Together(groups)
        self.columns = joined([layout[g.name] for g in groups])
        self.still = Constants(self.bodies)
        rows = sum(s.problem_rows for s in self.bodies)
        self.screen = solver.screen(groups, self.still.seen, rows)
        self.kept: Eliminated | None = None
        self.rate = AGED
        self.since, self.until, self.asked, self.immobile, self.pause = 0.0, 0.0, 0.0, 0, IDLE

    def supports(
        self, step: StepFormula, x: FloatArray, mechanics: Mechanics, work: Workspace,
        before: Mapping[str, BoolArray],
    ) -> dict[str, BoolArray] | None:
        """Supports that the sparse solver would return when started from the solution x of a step:
        {} for unchanged supports, None if the screening cannot decide."""
        at_solution = RowsAtSolution(self, step, x, mechanics, work)
        support, found = self.together.of(before), None
        if self.kept is not None and self.since < step.t < self.until:
            found = self.screen.settle(at_solution.around(self.kept, self._aged(step.t)), support)
        if found is None:
            new = Eliminated.of(mechanics, work, self.still)
            if new is None:
                return None
            at = at_solution.around(new, ROUGH)
            self._renew(new, at, at_solution, support, step.t)
            found = self.screen.settle(at, support)
        self.asked = step.t
        if found is None or found is support:
            return None if found is None else {}
        return {g.name: found[g.start : g.stop] for g in self.groups}

    def _renew(
        self, new: Eliminated, at: Quadratic, at_solution: "RowsAtSolution", support: BoolArray,
        t: float,
    ) -> None:
        """Keeps the condensed matrices of the step to t, for as long as the previous ones would
        have been valid."""
        old, age, step, lasts = self.kept, t - self.since, t - self.asked, 0.0
        self.kept, self.since = new, t
        if self.immobile > 0:
            self.immobile -= 1
        elif old is not None and age > 0.0:
            unlike = self.screen.unlike(at_solution.around(old, AGED), at, support)
            self.rate = GramError(*(CARE * u / age for u in unlike))
            lasts = min(GROWTH * age, OLDEST * step, *(
                a / max(u, TINY) for a, u in zip(AGED, self.rate, strict=True)))
            if lasts < step:
                self.immobile, self.pause = self.pause, min(2 * self.pause, LONGEST)
            else:
                self.pause = IDLE
        self.until = t + lasts

    def _aged(self, t: float) -> GramError:
        """Error bounds of the kept condensed matrices in a step to t, s."""
        age, rate = t - self.since, self.rate
        return GramError(ROUGH.sizes + age * rate.sizes, ROUGH.gram + age * rate.gram)


class RowsAtSolution:
    """Sampled rows at the solution x of a step that `mechanics` has just solved."""

    def __init__(
        self, screen: ElasticScreen, step: StepFormula, x: FloatArray, mechanics: Mechanics,
        work: Workspace,
    ) -> None:
        loop = work.loop
        assert loop is not None
        self.screen, self.work, self.t = screen, work, step.t
        self.c1, self.y = step.c1, loop.predicted + loop.d
        self.r = np.concatenate([s.residual(step, x, mechanics, work) for s in screen.bodies])
        self.c = x[screen.columns] * screen.still.lengths

    def around(self, e: Eliminated, error: GramError) -> Quadratic:
        """Quadratic model of the squared residual in the coefficients c, with rigid coordinates and
        multipliers condensed by e, which may be from an earlier step."""

        def left() -> tuple[float, float]:
            square = float(self.r.dot(self.r))
            for s in self.screen.bodies:
                far = s.rest(self.t)
                square += float(far.dot(far))
            return square, e.hidden(self.y)

        at = Quadratic(e.gram, e.slope(self.r), self.c, e.lengths, error, None, left)
        return at if error is not ROUGH else at._replace(exact=lambda: self._exact(e, at))

    def _exact(self, e: Eliminated, at: Quadratic) -> Quadratic:
        """The quadratic model with finite stiffness of the border rows and with frame-rotation
        terms."""
        V, VJ = e.gives()
        gram, slope = at.gram - VJ.T.dot(VJ), at.slope - V.dot(self.r).dot(VJ)
        row, screen = 0, self.screen
        for s, g in zip(screen.bodies, screen.groups, strict=True):
            own, rows = slice(g.start, g.stop), slice(row, row + s.first)
            near, far = (A / screen.still.lengths[own] for A in s.turning(self.work, self.c1))
            part = screen.still.Bt[own, rows].dot(near)
            gram[own, own] += part + part.T
            slope[own] += self.r[rows].dot(near) + s.rest(self.t).dot(far)
            row = rows.stop
        return Quadratic(
            np.asfortranarray(gram), slope, at.c, at.lengths, EXACT, None, at.left)


@dataclass(frozen=True, slots=True, eq=False)
class Screens:
    """Screening of thermal and elastic blocks for one set of sampled rows."""

    heat: HeatScreen | None
    elastic: ElasticScreen | None

    @classmethod
    def of(
        cls, base: Stepper, heat: Mapping[str, SampledHeat],
        elastic: Mapping[str, SampledElastic], solver: Any,
    ) -> "Screens | None":
        """Screening with the sparse solver's own decision rule; None for a solver that does not
        offer one."""
        if not isinstance(solver, ScreensSupport):
            return None
        hot = HeatScreen(heat, base.layout, solver) if heat else None
        if not elastic:
            return cls(hot, None)
        assert base.mechanics is not None
        return cls(hot, ElasticScreen(base.mechanics, elastic, base.layout, solver))
