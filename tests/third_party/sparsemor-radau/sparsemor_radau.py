"""Radau IIA with two stages, in a package of its own: an integrator with several solves a step."""

from dataclasses import replace
from math import sqrt

import numpy as np
from pydantic import Field

from sparsemor.core import (
    FloatArray,
    Integrator,
    Layout,
    NextStep,
    Solve,
    State,
    Status,
    StepOutcome,
    UpdateRule,
    UpdateRules,
    advanced,
    step_formula,
)

TIMES = (1.0 / 3.0, 1.0)
"""Times of the stages, as shares of the step."""
D = np.array([[1.5, 0.5], [-4.5, 2.5]])
"""Inverse of the method's coefficients: h v_i = sum_j D_ij (x_j - x_0), and a_i from v likewise."""
GAMMA = sqrt(6.0)
T = np.array([[GAMMA, 0.0], [8.0 * GAMMA - 4.0 * GAMMA**2, GAMMA]])
"""Triangular part with which the stages are swept. Its diagonal is the same in both, so that one
step solver serves them; det T = det D and the trace of T^-1 D is 2, so that sweeps at h = 0 end
after two, and the largest factor of a sweep on the imaginary axis is 0.18."""
SETTLED = 1e-6
"""Relative change below which sweeps that no longer shrink have met the accuracy of the solves."""


class RadauIIA(Integrator):
    """Radau IIA with two stages: third order, L-stable, by sweeps over the stages.

    Hairer and Wanner 1996, doi 10.1007/978-3-642-05221-7, Sec. IV.5 and IV.8. In a sweep stage i
    is an implicit Euler step of size h/gamma from x_0 - p/gamma with p = sum_j (D - T)_ij (x_j -
    x_0) of the sweep before and sum_(j<i) T_ij (x_j - x_0) of this one; v likewise. For constraints
    of positions x has order 3, v 2 and joint forces 1.
    """

    tolerance: float = Field(default=1e-11, gt=0.0, lt=1.0)
    """Change of the stages at which sweeps end, relative to the largest unknown of each block."""
    sweeps: int = Field(default=60, ge=2)
    """Largest number of sweeps; then the step ends as not converged."""

    @property
    def order(self) -> int:
        return 3

    def rules(self, h: float) -> UpdateRules:
        """Implicit Euler rules of a step of h/gamma, those of each solve."""
        g = h / GAMMA
        return UpdateRules(
            UpdateRule(np.array([g * g, g, 1.0]), np.array([[1.0, g, 0], [0, 1, 0], [0, 0, 0]])),
            UpdateRule(np.array([g, 1.0, 0.0]), np.array([[1.0, 0, 0], [0, 0, 0], [0, 0, 0]])))

    def advance(self, solve: Solve, step: NextStep) -> tuple[StepOutcome, State]:
        """Sweeps over both stages until these no longer change; the second one is the result."""
        old, h = step.state, step.h
        dx = np.outer(TIMES, h * old.v) + 0.5 * np.outer(np.square(TIMES), h * h * old.a)
        dv = np.outer(TIMES, h * old.a)
        solves, last = 0, np.inf
        for _ in range(self.sweeps):
            before_x, before_v = dx.copy(), dv.copy()
            for i, c in enumerate(TIMES):
                p, q = (T[i, :i] @ new[:i] + (D - T)[i] @ before
                        for new, before in ((dx, before_x), (dv, before_v)))
                base = replace(old, x=old.x - p / GAMMA, v=old.v - q / GAMMA)
                end = step.end if c == 1.0 else old.t + c * h
                formula = step_formula(step.rules, step.layout, base, h / GAMMA, end)
                outcome = solve(formula)
                solves += outcome.iterations
                if not outcome.status.ok:
                    return outcome, old
                stage = advanced(step.rules, step.layout, base, formula, outcome)
                dx[i], dv[i] = stage.x - old.x, stage.v - old.v
            change = _change(step.layout, dx - before_x, old.x + dx)
            if change <= self.tolerance or SETTLED > change > 0.5 * last:
                return replace(outcome, iterations=solves), stage
            last = change
        return replace(outcome, status=Status.NOT_CONVERGED, iterations=solves,
                       detail="the sweeps over the stages do not end"), old


def _change(layout: Layout, d: FloatArray, x: FloatArray) -> float:
    """Largest change of unknowns with rates, relative to the largest value of their block."""
    return max((float(np.abs(d[:, layout[b.name]]).max(initial=0.0))
                / max(float(np.abs(x[:, layout[b.name]]).max(initial=0.0)), 1e-300)
                for b in layout.differential), default=0.0)
