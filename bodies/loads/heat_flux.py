"""Given heat flux into a surface that moves with the body."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from sparsemor.bodies.fe.surface import surface_load
from sparsemor.bodies.loads.amplitude import Quantity
from sparsemor.bodies.loads.part import LoadPart
from sparsemor.bodies.targets import find_target, need_field
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part


class HeatFlux(Plugin):
    """q into the body over the boundary facets of each set."""

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    flux: Quantity
    """Heat flux, W/m^2, a number or a function of time; positive heats the body."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        loads = []
        for i, text in enumerate(self.on):
            target = find_target(parts, text, f"on.{i}")
            need_field(target, "thermal", f"on.{i}")
            body, facets = target.body, target.facets(f"on.{i}")
            assert body.mesh is not None
            loads.append((body, surface_load(body.mesh, facets, body.thickness)))
        return LoadPart(
            name, lambda layout: [b.heat_term(layout, w, self.flux.value) for b, w in loads])
