"""Static friction: elastic surfaces that stick, and slip at a limit."""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import FloatArray, FrictionLaw, InputError


class Stick(FrictionLaw):
    """Static friction: elastic surfaces that stick up to the coefficient of rest, and then slip.

    Below the limit of friction the surfaces are tied by springs in proportion to pressure: they
    stand still, displaced by at most `displacement`. They slip with the traction mu(v) p,
    mu(v) = mu + (mu_0 - mu) exp(-|v| / v_0).
    """

    coefficient: float = Field(gt=0)
    """Coefficient of friction mu of surfaces that slip."""
    displacement: float = Field(gt=0)
    """Elastic displacement at which surfaces at rest begin to slip, m: of the size of their
    roughness, such as 1e-6."""
    static: float | None = Field(default=None, gt=0)
    """Coefficient of friction mu_0 at rest; `coefficient` when not given."""
    decay_velocity: float | None = Field(default=None, gt=0)
    """Slip speed v_0 over which the coefficient falls from `static` to `coefficient`, m/s."""
    patches: int = Field(default=32, ge=1, le=10_000)
    """Largest number of patches of the first surface, each of which sticks or slips for itself."""

    @model_validator(mode="after")
    def _falls(self) -> Self:
        if (self.static is None) is not (self.decay_velocity is None):
            raise InputError("static and decay_velocity belong together: give both or none",
                             "static" if self.static is None else "decay_velocity")
        return self

    @property
    def bristles(self) -> tuple[float, int]:
        return self.displacement, self.patches

    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        sign, mu = np.sign(slip), self.coefficient
        if self.static is None or self.decay_velocity is None:
            return mu * sign, np.zeros_like(slip)
        more = (self.static - mu) * np.exp(-np.abs(slip) / self.decay_velocity)
        return sign * (mu + more), -more / self.decay_velocity
