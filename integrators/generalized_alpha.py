"""Generalized-alpha method for index-3 multibody systems, with its variant for first-order
equations."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import Field

from sparsemor.core import FloatArray, Layout, Note, Plugin, State, StepFormula, joints_with_forces

UNDAMPED = 0.95
"""Largest rho_inf for which errors of joint forces decay within some hundred steps."""


class _Second(NamedTuple):
    """Parameters for second-order equations: Arnold and Bruels 2007, doi
    10.1007/s11044-007-9084-0."""

    am: float
    af: float
    gamma: float
    beta: float


class _First(NamedTuple):
    """Parameters for first-order equations: Jansen, Whiting and Hulbert 2000, doi
    10.1016/S0045-7825(00)00203-6."""

    am: float
    af: float
    gamma: float


class GeneralizedAlpha(Plugin):
    """Generalized-alpha method, second order, with spectral radius `rho_inf` at high frequency.

    With the algorithmic acceleration b (kept in memory) and the true acceleration a: q1 = q + h v +
    h^2 ((1/2 - beta) b + beta b1), v1 = v + h ((1 - gamma) b + gamma b1), (1 - am) b1 + am b = (1 -
    af) a1 + af a. First-order unknowns such as temperatures have an algorithmic rate s instead of
    b: T1 = T + h ((1 - gamma) s + gamma s1), (1 - am) s1 + am s = (1 - af) T1' + af T'. The
    equations of motion are satisfied at the new time. Rates of algebraic unknowns are zero.
    """

    rho_inf: float = Field(default=0.8, ge=0.0, le=1.0)
    """Spectral radius at infinite frequency: 1 conserves all energy, 0 removes frequencies that the
    step does not resolve within one step."""

    @property
    def order(self) -> int:
        return 2

    def notes(self, layout: Layout) -> tuple[Note, ...]:
        """A warning where joint forces are unknowns and `rho_inf` is too close to 1 to damp their
        errors."""
        joints = joints_with_forces(layout)
        if self.rho_inf <= UNDAMPED or not joints:
            return ()
        return (Note(
            f"integrator.rho_inf = {self.rho_inf:g} hardly damps errors of joint forces "
            f"({', '.join(joints)}): they alternate from step to step, with rho_inf 1 by an "
            f"amplitude that grows; take at most {UNDAMPED:g} (0.8 is usual), or bdf2, where "
            "forces matter", "undamped_forces"),)

    def start(self, layout: Layout, state: State) -> State:
        """Initial state with memory (n, 1): algorithmic acceleration (or rate), initially equal to
        the true one."""
        memory = np.zeros((state.x.size, 1))
        memory[layout.second, 0] = state.a[layout.second]
        memory[layout.first, 0] = state.v[layout.first]
        return replace(state, memory=memory)

    def formula(self, layout: Layout, state: State, h: float) -> StepFormula:
        """Coefficients of v = c1 x + r1 and a = c2 x + r2 at the new time state.t + h; h: step,
        s."""
        am, af, gamma, beta = self._second()
        r1, r2 = np.zeros(state.x.size), np.zeros(state.x.size)
        part = layout.second
        v, b = state.v[part], state.memory[part, 0]
        c1, c2 = gamma / (beta * h), (1.0 - am) / ((1.0 - af) * beta * h * h)
        q = state.x[part] + h * (v + (h * (0.5 - beta)) * b)
        r1[part] = v + (h * (1.0 - gamma)) * b - c1 * q
        r2[part] = (am / (1.0 - af)) * b - (af / (1.0 - af)) * state.a[part] - c2 * q

        am, af, gamma = self._first()
        part = layout.first
        s = state.memory[part, 0]
        c1_first = (1.0 - am) / ((1.0 - af) * gamma * h)
        q = state.x[part] + (h * (1.0 - gamma)) * s
        r1[part] = (am / (1.0 - af)) * s - (af / (1.0 - af)) * state.v[part] - c1_first * q
        return StepFormula(state.t + h, c1, c2, c1_first, r1, r2)

    def advance(
        self, layout: Layout, state: State, formula: StepFormula, x: FloatArray, h: float
    ) -> State:
        v, a, memory = np.zeros(x.size), np.zeros(x.size), np.zeros((x.size, 1))
        am, af, _, _ = self._second()
        part = layout.second
        v[part] = formula.c1 * x[part] + formula.r1[part]
        a[part] = formula.c2 * x[part] + formula.r2[part]
        memory[part, 0] = _blended(am, af, a[part], state.a[part], state.memory[part, 0])

        am, af, _ = self._first()
        part = layout.first
        v[part] = formula.c1_first * x[part] + formula.r1[part]
        memory[part, 0] = _blended(am, af, v[part], state.v[part], state.memory[part, 0])
        return State(formula.t, x, v, a, memory)

    def _second(self) -> _Second:
        rho = self.rho_inf
        am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        gamma = 0.5 + af - am
        return _Second(am, af, gamma, 0.25 * (gamma + 0.5) ** 2)

    def _first(self) -> _First:
        rho = self.rho_inf
        am, af = 1.0 - 0.5 * (3.0 - rho) / (1.0 + rho), 1.0 - 1.0 / (1.0 + rho)
        return _First(am, af, 0.5 + af - am)


def _blended(am: float, af: float, new: FloatArray, old: FloatArray, b: FloatArray) -> FloatArray:
    """The algorithmic rate b1 at the new time from (1 - am) b1 + am b = (1 - af) new + af old."""
    return ((1.0 - af) * new + af * old - am * b) / (1.0 - am)
