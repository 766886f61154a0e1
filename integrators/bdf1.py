"""Implicit Euler time integration (Eq. 24 of the paper), for first- and second-order equations."""

from dataclasses import replace

import numpy as np

from sparsemor.core import FloatArray, Layout, Plugin, State, StepFormula


class Bdf1(Plugin):
    """Implicit Euler (BDF1), first order: v = (x - x0)/h, a = (x - x0 - h v0)/h^2.

    Stable for every step. An oscillation of angular frequency w keeps the fraction
    1/sqrt(1 + w^2 h^2) of its amplitude in each step.
    """

    @property
    def order(self) -> int:
        return 1

    def start(self, layout: Layout, state: State) -> State:
        """Initial state with empty integrator memory (n, 0): a one-step formula needs no
        history."""
        return replace(state, memory=np.zeros((state.x.size, 0)))

    def formula(self, layout: Layout, state: State, h: float) -> StepFormula:
        """Coefficients of v = c1 x + r1 and a = c2 x + r2 at the new time state.t + h; h: step,
        s."""
        c1 = 1.0 / h
        c2 = c1 * c1
        r1 = -c1 * state.x
        return StepFormula(state.t + h, c1, c2, c1, r1, c1 * (r1 - state.v))

    def advance(
        self, layout: Layout, state: State, formula: StepFormula, x: FloatArray, h: float
    ) -> State:
        # x - x0 first: c1 x + r1 would round at eps x/h
        v = (x - state.x) * formula.c1
        return State(formula.t, x, v, (v - state.v) * formula.c1, state.memory)
