"""Convection: heat exchange with a fluid of prescribed temperature."""

from collections.abc import Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from sparsemor.bodies.fem.surface import surface_load, surface_mass
from sparsemor.bodies.loads.amplitude import NumberOrFunction
from sparsemor.bodies.loads.part import LoadPart
from sparsemor.bodies.targets import find_surfaces
from sparsemor.core import Effect, Equations, Part, Plugin


class Convection(Plugin):
    """Convection: heat flux q = h (T_fluid - T) over the boundary facets of each set."""

    acts_on: ClassVar[Effect] = "temperature"

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    film: float = Field(gt=0)
    """Film coefficient h, W/(m^2 K)."""
    temperature: NumberOrFunction
    """Temperature of the fluid, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        loads = []
        for body, mesh, facets in find_surfaces(parts, self.on, "thermal"):
            h = self.film * body.thickness
            loads.append((body, h * surface_load(mesh, facets, 1.0),
                          surface_mass(mesh, facets, h)))

        def write(equations: Equations) -> None:
            for b, w, S in loads:
                b.heat_load(equations, w, self.temperature.value, S)

        return LoadPart(name, write, surroundings=self.temperature.value)
