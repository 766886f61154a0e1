"""Second-order backward differentiation formula (BDF2), for first- and second-order equations."""

from dataclasses import replace

import numpy as np

from sparsemor.core import FloatArray, Layout, Plugin, State, StepFormula


class Bdf2(Plugin):
    """Backward differentiation formula of second order (BDF2), with constant step.

    v = (3 x - 4 x0 + x_)/(2 h), a = (3 v - 4 v0 + v_)/(2 h), with x_, v_ one step before x0, v0.
    Second-order accurate and stable for every step: the formula for first-order equations is A- and
    L-stable (Hairer and Wanner 1996, doi 10.1007/978-3-642-05221-7, Sec. V.1), and second-order
    equations are integrated by the same formula as x' = v, v' = a. The first step uses a Taylor
    polynomial about the initial state for the missing values, x_ = x0 - h v0 + h^2/2 a0 and v_ = v0
    - h a0, so that c1 and c2 are the same in every step.

    The memory (n, 2) contains the differences of x_ and v_ from that Taylor polynomial. It is zero
    after `start`, so that the first step needs no separate formula, and a restart with another step
    size rebuilds the history from the current rates.
    """

    @property
    def order(self) -> int:
        return 2

    def start(self, layout: Layout, state: State) -> State:
        """Initial state with memory (n, 2) zero: the missing earlier values follow from the current
        rates."""
        return replace(state, memory=np.zeros((state.x.size, 2)))

    def formula(self, layout: Layout, state: State, h: float) -> StepFormula:
        """Coefficients of v = c1 x + r1 and a = c2 x + r2 at the new time state.t + h; h: step,
        s."""
        c1 = 1.5 / h
        part = slice(0, layout.algebraic.start)
        r1, r2 = np.zeros(state.x.size), np.zeros(state.x.size)
        dx, dv = _differences(state, part, h)
        r1[part] = -c1 * state.x[part] - dx / (2.0 * h)
        r2[part] = c1 * (r1[part] - state.v[part]) - dv / (2.0 * h)
        return StepFormula(state.t + h, c1, c1 * c1, c1, r1, r2)

    def advance(
        self, layout: Layout, state: State, formula: StepFormula, x: FloatArray, h: float
    ) -> State:
        part = slice(0, layout.algebraic.start)
        v, a, memory = np.zeros(x.size), np.zeros(x.size), np.zeros((x.size, 2))
        before, speed = _differences(state, part, h)
        # differences first: c1 x + r1 would round at eps x/h
        dx = x[part] - state.x[part]
        v[part] = (3.0 * dx - before) / (2.0 * h)
        dv = v[part] - state.v[part]
        a[part] = (3.0 * dv - speed) / (2.0 * h)
        memory[part, 0] = h * (v[part] - (0.5 * h) * a[part]) - dx
        memory[part, 1] = h * a[part] - dv
        return State(formula.t, x, v, a, memory)


def _differences(state: State, part: slice, h: float) -> tuple[FloatArray, FloatArray]:
    """Backward differences x0 - x_ and v0 - v_ of the unknowns that have rates (not of
    multipliers)."""
    v, a, memory = state.v[part], state.a[part], state.memory[part]
    return h * (v - (0.5 * h) * a) - memory[:, 0], h * a - memory[:, 1]
