"""The second backward differentiation formula, for unknowns of every order."""

from dataclasses import replace

import numpy as np

from sparsemor.core import FloatArray, Layout, Plugin, State, StepFormula


class Bdf2(Plugin):
    """Backward differentiation formula of second order (BDF2), with constant step.

    v = (3 x - 4 x0 + x_)/(2 h), a = (3 v - 4 v0 + v_)/(2 h), with x_, v_ one step before x0, v0.

    Second-order accurate, stable for every step (the first-order rule is A- and L-stable, Hairer
    and Wanner 1996, doi 10.1007/978-3-642-05221-7, Sec. V.1; the second-order rule is the same
    one on x' = v, v' = a). The step before the first one is made from the start,
    x_ = x0 - h v0 + h^2/2 a0 and v_ = v0 - h a0, so that c1 and c2 are the same in every step.

    Memory (n, 2) is by how much x_ and v_ depart from that Taylor polynomial. It is zero after
    `start`, so no step is a special case, and a restart at another h computes its history again.
    """

    @property
    def order(self) -> int:
        return 2

    def start(self, layout: Layout, state: State) -> State:
        """The same state with memory (n, 2) zero: a history that follows its own rates."""
        return replace(state, memory=np.zeros((state.x.size, 2)))

    def formula(self, layout: Layout, state: State, h: float) -> StepFormula:
        """The substitution at state.t + h; h in s."""
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
    """x0 - x_ and v0 - v_ of the unknowns that have rates."""
    v, a, memory = state.v[part], state.a[part], state.memory[part]
    return h * (v - (0.5 * h) * a) - memory[:, 0], h * a - memory[:, 1]
