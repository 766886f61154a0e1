"""Carbon steel at elevated temperatures, as EN 1993-1-2:2005 (Eurocode 3, structural fire design)
defines it."""

from functools import cached_property

import numpy as np
from pydantic import Field

from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.core import FloatArray, Material, MaterialProperties

ZERO_CELSIUS = 273.15
"""0 degrees Celsius, K."""
HOTTEST = 1100
"""Highest tabulated temperature, degrees Celsius; the modulus vanishes at 1200."""
REDUCTION = {20: 1.0, 100: 1.0, 200: 0.9, 300: 0.8, 400: 0.7, 500: 0.6, 600: 0.31, 700: 0.13,
             800: 0.09, 900: 0.0675, 1000: 0.045, 1100: 0.0225}
"""Reduction factor of Young's modulus by temperature in degrees Celsius, table 3.1."""


def elongation(celsius: FloatArray) -> FloatArray:
    """Relative thermal elongation from 20 degrees Celsius on, section 3.4.1.1."""
    return np.where(celsius < 750, 1.2e-5 * celsius + 0.4e-8 * celsius**2 - 2.416e-4, np.where(
        celsius <= 860, 1.1e-2, 2e-5 * celsius - 6.2e-3))


def specific_heat(celsius: FloatArray) -> FloatArray:
    """Specific heat, J/(kg K), section 3.4.1.2, with its peak at 735 degrees Celsius."""
    low = np.minimum(celsius, 600.0)
    below = 425 + 0.773 * low - 1.69e-3 * low**2 + 2.22e-6 * low**3
    rising = 666 + 13002 / (738 - np.clip(celsius, 600.0, 735.0))
    falling = 545 + 17820 / (np.clip(celsius, 735.0, 900.0) - 731)
    return np.where(celsius < 600, below, np.where(celsius < 735, rising, np.where(
        celsius < 900, falling, 650.0)))


def conductivity(celsius: FloatArray) -> FloatArray:
    """Thermal conductivity, W/(m K), section 3.4.1.3."""
    return np.where(celsius < 800, 54.0 - 3.33e-2 * celsius, 27.3)


def _curve(celsius: FloatArray, values: FloatArray) -> TemperatureCurve:
    return TemperatureCurve(temperatures=tuple((celsius + ZERO_CELSIUS).tolist()),
                            values=tuple(values.tolist()))


class CarbonSteel(Material):
    """Carbon steel by EN 1993-1-2:2005 from 20 to 1100 degrees Celsius: modulus, expansion,
    conductivity and specific heat depend on temperature.

    The mean coefficient of expansion counts from 20 degrees Celsius: the reference temperature of
    the body is 293.15 K, its default.
    """

    modulus: float = Field(default=2.1e11, gt=0)
    """Young's modulus at 20 degrees Celsius, Pa."""
    nu: float = Field(default=0.3, gt=-1, lt=0.5)
    """Poisson's ratio."""
    rho: float = Field(default=7850.0, gt=0)
    """Density, kg/m3."""

    def properties(self) -> MaterialProperties:
        return self._properties

    @cached_property
    def _properties(self) -> MaterialProperties:
        """Tables of the standard: reduction of the modulus, mean expansion from 20 degrees Celsius,
        conductivity, specific heat."""
        E = _curve(np.array(list(REDUCTION), dtype=np.float64),
                   self.modulus * np.array(list(REDUCTION.values())))
        at = np.array([*range(40, 760, 40), 750, 780, 820, 860, 950, HOTTEST], dtype=np.float64)
        mean = elongation(at) / (at - 20.0)
        # mean coefficient at 20 degrees Celsius, 0 / 0 there: extrapolated from the next two
        first = mean[0] + (mean[1] - mean[0]) * (20.0 - at[0]) / (at[1] - at[0])
        alpha = _curve(np.concatenate([[20.0], at]), np.concatenate([[first], mean]))
        k = _curve(np.array([20.0, 801.8018018018018, HOTTEST]),
                   np.array([54.0 - 3.33e-2 * 20.0, 27.3, 27.3]))
        at = np.array([20, *range(50, 600, 50), *range(600, 700, 20), *range(700, 730, 5),
                       *range(730, 741), *range(742, 760, 3), *range(760, 900, 20), 900, HOTTEST],
                      dtype=np.float64)
        return MaterialProperties(self.rho, E, self.nu, alpha, k, _curve(at, specific_heat(at)))
