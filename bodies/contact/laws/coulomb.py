"""Regularised Coulomb friction."""

import numpy as np
from pydantic import Field

from sparsemor.core import FloatArray, FrictionLaw


class Coulomb(FrictionLaw):
    """Regularised Coulomb friction: traction mu p q (3 - q^2) / 2 with q = v / v_c in [-1, 1].

    There is no static friction: below v_c a loaded body creeps at the speed where the traction
    balances the load.
    """

    coefficient: float = Field(ge=0)
    """Coefficient of friction mu."""
    critical_velocity: float = Field(gt=0)
    """Slip speed v_c above which the full friction acts, m/s."""

    @property
    def breaks(self) -> tuple[float, ...]:
        return (-self.critical_velocity, self.critical_velocity)

    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        q = np.clip(slip / self.critical_velocity, -1.0, 1.0)
        mu = self.coefficient
        return mu * q * (1.5 - 0.5 * q * q), 1.5 * mu / self.critical_velocity * (1.0 - q * q)
