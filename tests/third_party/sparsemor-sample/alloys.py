"""Alloys by their names: a material in a package of its own."""

from typing import Literal, NamedTuple

from sparsemor.core import Plugin


class Constants(NamedTuple):
    """Density kg/m3, Young's modulus Pa, Poisson's ratio, thermal expansion 1/K, conductivity
    W/(m K), specific heat J/(kg K)."""

    rho: float
    E: float
    nu: float
    alpha: float
    k: float
    c: float


TABLE = {
    "6061-T6": Constants(2700.0, 68.9e9, 0.33, 23.6e-6, 167.0, 896.0),
    "Ti-6Al-4V": Constants(4430.0, 113.8e9, 0.342, 8.6e-6, 6.7, 526.3),
}
"""At room temperature; expansion from 20 to 100 degrees Celsius. Aluminium 6061-T6 and titanium
Ti-6Al-4V ELI, annealed: material data sheets of Aerospace Specification Metals, asm.matweb.com."""


class Alloy(Plugin):
    """An alloy by its designation, constants at room temperature."""

    name: Literal["6061-T6", "Ti-6Al-4V"] = "6061-T6"
    """Designation."""

    @property
    def rho(self) -> float:
        return TABLE[self.name].rho

    @property
    def E(self) -> float | None:
        return TABLE[self.name].E

    @property
    def nu(self) -> float | None:
        return TABLE[self.name].nu

    @property
    def alpha(self) -> float:
        return TABLE[self.name].alpha

    @property
    def k(self) -> float | None:
        return TABLE[self.name].k

    @property
    def c(self) -> float | None:
        return TABLE[self.name].c
