"""Second-order backward differentiation formula (BDF2), for first- and second-order equations."""

from dataclasses import replace

import numpy as np

from sparsemor.core import (
    FloatArray,
    Integrator,
    Layout,
    State,
    UpdateRule,
    UpdateRules,
)


class Bdf2(Integrator):
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

    def rules(self, h: float) -> UpdateRules:
        """Update rules in x, v, a and the two columns of the memory, of a step of size h, s.

        A vector (5,) below holds the factors of the old [x0, v0, a0, m0, m1] in a value, a number
        with d (dx, dv, da) the factor of the new highest rate q (acceleration, or rate of
        first-order unknowns). x_, v_: values one step before x0, v0; memory m0 = x_ - (x0 - h v0 +
        h^2/2 a0), m1 = v_ - (v0 - h a0).
        """
        x0, v0, a0, m0, m1 = np.eye(5)
        backward = h * (v0 - 0.5 * h * a0) - m0  # x0 - x_
        slower = h * a0 - m1  # v0 - v_
        gain = 2.0 * h / 3.0

        def rule(v: FloatArray, dv: float, a: FloatArray, da: float) -> UpdateRule:
            """Rule for rates v + dv q and a + da q at the new time; v, a (5,)."""
            x, dx = x0 + gain * v + backward / 3.0, gain * dv
            # the last two: new memory, differences of x0, v0 from a Taylor polynomial back in time
            old = np.array([x, v, a, h * (v - 0.5 * h * a) - (x - x0), h * a - (v - v0)])
            new = np.array([dx, dv, da, h * (dv - 0.5 * h * da) - dx, h * da - dv])
            return UpdateRule(new, old)

        zero = np.zeros(5)
        second = rule(v0 + slower / 3.0, gain, zero, 1.0)
        first = rule(zero, 1.0, (-v0 - slower / 3.0) / gain, 1.0 / gain)
        return UpdateRules(second, first)
