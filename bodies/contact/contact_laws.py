"""Laws of pressure and friction per area: elastic foundation (Winkler: independent springs and
dampers under the surface, without shear), regularised Coulomb friction, and static friction of
elastic surfaces that stick and slip at a limit."""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import FloatArray, FrictionLaw, InputError, NormalLaw


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
        return (-self.critical_velocity, self.critical_velocity)  # where `ratio` is not smooth

    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Traction over pressure, with the sign of the slip speed v, m/s, and its derivative."""
        q = np.clip(slip / self.critical_velocity, -1.0, 1.0)
        mu = self.coefficient
        return mu * q * (1.5 - 0.5 * q * q), 1.5 * mu / self.critical_velocity * (1.0 - q * q)


class ElasticFoundation(NormalLaw):
    """Elastic foundation: pressure p = max(0, K d + D s(d / d0) d') at penetration d.

    s(r) = 3 r^2 - 2 r^3 rises from 0 to 1.

    All constants are per area: a thin layer of modulus E and height b has K = E / b, in N/m3. The
    increase of the damping with depth makes the pressure continuous at first contact.
    """

    stiffness: float = Field(gt=0)
    """Foundation modulus K, N/m3 (pressure in Pa per metre of penetration)."""
    damping: float = Field(default=0.0, ge=0)
    """Damping modulus D, N s/m3."""
    damping_depth: float | None = Field(default=None, gt=0)
    """Penetration d0 above which the damping acts in full, m."""

    @model_validator(mode="after")
    def _ramp(self) -> Self:
        if self.damping > 0 and self.damping_depth is None:
            raise InputError("missing: damping that sets in at once makes the pressure jump; give "
                             "the penetration (m) over which it sets in, such as a hundredth of "
                             "the penetration at rest", "damping_depth")
        return self

    @property
    def breaks(self) -> tuple[float, ...]:
        d0 = self.damping_depth  # facets are cut at these depths, so that few points are enough
        return (0.5 * d0, d0) if self.damping > 0 and d0 is not None else ()

    def pressure(
        self, depth: FloatArray, rate: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Pressure, Pa, and its derivatives by penetration d, m, and rate d', m/s: K d + ramp d',
        ramp = D s(d / d0), s(r) = 3 r^2 - 2 r^3; the caller cuts off tension."""
        K, D = self.stiffness, self.damping
        if D == 0.0 or self.damping_depth is None:
            return K * depth, np.full_like(depth, K), np.zeros_like(depth)
        r = np.clip(depth / self.damping_depth, 0.0, 1.0)
        ramp = D * r * r * (3.0 - 2.0 * r)
        slope = D * 6.0 * r * (1.0 - r) / self.damping_depth
        return K * depth + ramp * rate, K + slope * rate, ramp


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
        return self.displacement, self.patches  # deflection at the limit, m; patches at most

    def ratio(self, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Traction of slipping surfaces over pressure, with the sign of the slip speed v, m/s, and
        its derivative."""
        sign, mu = np.sign(slip), self.coefficient
        if self.static is None or self.decay_velocity is None:
            return mu * sign, np.zeros_like(slip)
        more = (self.static - mu) * np.exp(-np.abs(slip) / self.decay_velocity)
        return sign * (mu + more), -more / self.decay_velocity
