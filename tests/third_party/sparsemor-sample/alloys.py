"""Alloys by their names: a material in a package of its own."""

from typing import Literal

from sparsemor.core import Material, MaterialProperties

TABLE = {
    "6061-T6": MaterialProperties(2700.0, 68.9e9, 0.33, 23.6e-6, 167.0, 896.0),
    "Ti-6Al-4V": MaterialProperties(4430.0, 113.8e9, 0.342, 8.6e-6, 6.7, 526.3),
}
"""At room temperature; expansion from 20 to 100 degrees Celsius. Aluminium 6061-T6 and titanium
Ti-6Al-4V ELI, annealed: material data sheets of Aerospace Specification Metals, asm.matweb.com."""


class Alloy(Material):
    """An alloy by its designation, constants at room temperature."""

    name: Literal["6061-T6", "Ti-6Al-4V"] = "6061-T6"
    """Designation."""

    def properties(self) -> MaterialProperties:
        return TABLE[self.name]
