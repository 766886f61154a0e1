"""Implicit Euler time integration (Eq. 24 of the paper), for first- and second-order equations."""

import numpy as np

from sparsemor.core import (
    Integrator,
    UpdateRule,
    UpdateRules,
)


class Bdf1(Integrator):
    """Implicit Euler (BDF1), first order: v = v0 + h a, x = x0 + h v with a, v at the new time.

    Stable for every step. An oscillation of angular frequency w keeps the fraction
    1/sqrt(1 + w^2 h^2) of its amplitude in each step.
    """

    @property
    def order(self) -> int:
        return 1

    def rules(self, h: float) -> UpdateRules:
        """Update rules of a step of size h, s, for second-order unknowns, then first-order ones:
        [x, v, a] at the new time = (first array) q + (second array) [x0, v0, a0], with q the new
        acceleration, or the new rate v of first-order unknowns."""
        return UpdateRules(
            UpdateRule(np.array([h * h, h, 1.0]), np.array([[1.0, h, 0], [0, 1, 0], [0, 0, 0]])),
            UpdateRule(np.array([h, 1.0, 0.0]), np.array([[1.0, 0, 0], [0, 0, 0], [0, 0, 0]])))
