"""Pressure on a surface, along the normals of the undeformed body."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field, model_validator

from sparsemor.bodies.body_set import find_surfaces, surface_notes
from sparsemor.bodies.fem.surface import facet_measures, surface_normal_load
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction
from sparsemor.core import Equations, InputError, LoadPlugin, Part


class Pressure(LoadPlugin):
    """Pressure: force per area -p n over the boundary facets of each set, positive inwards.

    Give either the pressure or the total force.
    """

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    pressure: NumberOrFunction | None = None
    """Pressure, Pa, a number or a function of time."""
    force: NumberOrFunction | None = None
    """Total force, N, instead of a pressure: pressure times the area of all sets, a number or a
    function of time; independent of how well the mesh approximates a curved outline."""

    @model_validator(mode="after")
    def _one(self) -> "Pressure":
        if (self.pressure is None) is (self.force is None):
            raise InputError("give either `pressure` (Pa) or `force` (N), one of them", "pressure")
        return self

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        surfaces = find_surfaces(parts, self.on, "mechanical")
        size = self.pressure or self.force
        assert size is not None
        area = 1.0 if self.force is None else sum(
            body.thickness * float(facet_measures(mesh, facets).sum())
            for body, mesh, facets in surfaces)
        loads = [(body, -surface_normal_load(mesh, facets, body.thickness) / area)
                 for body, mesh, facets in surfaces]

        def write(equations: Equations) -> None:
            for b, w in loads:
                b.body_force(equations, w, size.value)

        return LoadPart(name, write, notes=surface_notes(parts, name, self.on))
