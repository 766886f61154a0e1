"""Prescribed heat flux into a surface that moves with the body."""

from collections.abc import Mapping
from typing import Annotated, ClassVar

from pydantic import Field

from sparsemor.bodies.body_set import find_surfaces, surface_notes
from sparsemor.bodies.fem.surface import surface_load
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction
from sparsemor.core import Effect, Equations, LoadPlugin, Part


class HeatFlux(LoadPlugin):
    """Heat flux: prescribed q into the body over the boundary facets of each set."""

    acts_on: ClassVar[Effect] = "temperature"

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    flux: NumberOrFunction
    """Heat flux, W/m^2, a number or a function of time; positive heats the body."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        loads = [(body, surface_load(mesh, facets, body.thickness))
                 for body, mesh, facets in find_surfaces(parts, self.on, "thermal")]

        def write(equations: Equations) -> None:
            for b, w in loads:
                b.heat_load(equations, w, self.flux.value)

        return LoadPart(name, write, notes=surface_notes(parts, name, self.on))
