"""Elastic foundation (Winkler): independent springs and dampers under the surface, without shear.
"""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from sparsemor.core import FloatArray, InputError, NormalLaw


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
        d0 = self.damping_depth
        return (0.5 * d0, d0) if self.damping > 0 and d0 is not None else ()

    def pressure(
        self, depth: FloatArray, rate: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        K, D = self.stiffness, self.damping
        if D == 0.0 or self.damping_depth is None:
            return K * depth, np.full_like(depth, K), np.zeros_like(depth)
        r = np.clip(depth / self.damping_depth, 0.0, 1.0)
        ramp = D * r * r * (3.0 - 2.0 * r)
        slope = D * 6.0 * r * (1.0 - r) / self.damping_depth
        return K * depth + ramp * rate, K + slope * rate, ramp
