"""Pressure on a surface, along the normals of the undeformed body."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from sparsemor.bodies.fe.surface import surface_normal_load
from sparsemor.bodies.loads.amplitude import Quantity
from sparsemor.bodies.loads.part import LoadPart
from sparsemor.bodies.loads.vectors import body_force
from sparsemor.bodies.targets import find_surfaces
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part


class Pressure(Plugin):
    """Force per area -p n over the boundary facets of each set; positive pushes inwards."""

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    pressure: Quantity
    """Pressure, Pa, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        loads = []
        for body, mesh, facets in find_surfaces(parts, self.on, "mechanical"):
            loads.append((body, -surface_normal_load(mesh, facets, body.thickness)))
        return LoadPart(name, lambda layout: [
            body_force(b, layout, w, self.pressure.value) for b, w in loads])
