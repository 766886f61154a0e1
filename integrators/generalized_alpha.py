"""Generalized-alpha method for index-3 multibody systems, and BDF2 for first-order
equations."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from pydantic import Field

from sparsemor.core import FloatArray, Integrator, Layout, Note, State, UpdateRule, UpdateRules
from sparsemor.core.protocols.layout import joints_with_forces

UNDAMPED = 0.95
"""Largest rho_inf for which errors of joint forces decay within some hundred steps."""


class _Second(NamedTuple):
    """Parameters for second-order equations: Arnold and Bruels 2007, doi
    10.1007/s11044-007-9084-0."""

    am: float
    af: float
    gamma: float
    beta: float


class GeneralizedAlpha(Integrator):
    """Generalized-alpha method, second order, with spectral radius `rho_inf` at high frequency.

    With the algorithmic acceleration b (kept in memory) and the true acceleration a: q1 = q + h v +
    h^2 ((1/2 - beta) b + beta b1), v1 = v + h ((1 - gamma) b + gamma b1), (1 - am) b1 + am b = (1 -
    af) a1 + af a. The equations of motion are satisfied at the new time. First-order unknowns such
    as temperatures have no waves to conserve, and follow BDF2, by which the heat content of a
    material is conserved, too. Rates of algebraic unknowns are zero.
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
        """Initial state with memory (n, 1): algorithmic acceleration, initially equal to the true
        one, and zero for first-order unknowns (bdf2.py)."""
        memory = np.zeros((state.x.size, 1))
        memory[layout.second, 0] = state.a[layout.second]
        return replace(state, memory=memory)

    def rules(self, h: float) -> UpdateRules:
        """Update rules in x, v, a and the memory, of a step of size h, s.

        [x, v, a, b] at the new time = (first array) q + (second array) [x, v, a, b] at the old one,
        with q the new acceleration, or the new rate of first-order unknowns; b: the memory. x, v,
        a, b (4,) below: factors of the old values in each; am, af, gamma, beta: parameters of the
        method that belong to `rho_inf`.
        """
        am, af, gamma, beta = self._second()
        x, v, a, b = np.eye(4)
        # new algorithmic acceleration: b1 . [x, v, a, b] + db times the new acceleration
        b1, db = _blended(am, af, a, b)
        second = UpdateRule(
            np.array([h * h * beta * db, h * gamma * db, 1.0, db]),
            np.array([x + h * v + h * h * ((0.5 - beta) * b + beta * b1),
                      v + h * ((1.0 - gamma) * b + gamma * b1), 0.0 * a, b1]))
        # BDF2; its memory is x_ less x0 - h v0, with x_ one step before x0
        backward = (h * v - b) / 3.0
        first = UpdateRule(
            np.array([2.0 * h / 3.0, 1.0, 0.0, h / 3.0]),
            np.array([x + backward, 0.0 * v, 0.0 * a, -backward]))
        return UpdateRules(second, first)

    def _second(self) -> _Second:
        """Parameters am, af, gamma, beta that belong to `rho_inf`."""
        rho = self.rho_inf
        am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        gamma = 0.5 + af - am
        return _Second(am, af, gamma, 0.25 * (gamma + 0.5) ** 2)


def _blended(
    am: float, af: float, old: FloatArray, b: FloatArray
) -> tuple[FloatArray, float]:
    """The algorithmic rate b1 at the new time from (1 - am) b1 + am b = (1 - af) q + af old: its
    part without the new rate q, and the factor of q."""
    return (af * old - am * b) / (1.0 - am), (1.0 - af) / (1.0 - am)
