"""Prescribed surface force per area, rotating with the body or fixed in space, and pressure along
the normals of the undeformed body."""

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from sparsemor.bodies.body_set import find_surfaces, surface_notes
from sparsemor.bodies.fem.integrals import facet_measures, surface_load, surface_normal_load
from sparsemor.bodies.loads.built_load import (
    LoadPart,
    NumberOrFunction,
    Vector,
    amplitude,
    components,
)
from sparsemor.core import Equations, InputError, LoadPlugin, Part


class Traction(LoadPlugin):
    """Traction: a force per area over the boundary facets of each set."""

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    traction: Vector
    """Force per area, Pa: two components in the plane, three in space."""
    axes: Literal["body", "space"] = "body"
    """Axes of the traction: `body` turns with the frame, `space` does not."""
    factor: NumberOrFunction | None = None
    """Function of time that multiplies the load; 1 by default."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """Nodal forces of the traction, in axes of space or of the body: areas of the nodes, m2,
        times the traction."""
        f = amplitude(self.factor)
        loads = [(body, surface_load(mesh, facets, body.thickness),
                  components(body, self.traction, "traction"))
                 for body, mesh, facets in find_surfaces(parts, self.on, "mechanical")]

        def write(equations: Equations) -> None:
            for b, w, p in loads:
                if self.axes == "space":
                    b.space_force(equations, w, p, f)
                else:
                    b.body_force(equations, np.outer(w, p), f)

        return LoadPart(name, write, notes=surface_notes(parts, name, self.on))


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
        """Nodal forces along the normals, of a pressure or of a total force over the area."""
        surfaces = find_surfaces(parts, self.on, "mechanical")
        size = self.pressure or self.force
        assert size is not None
        # nodal forces of a unit pressure, or of a unit force over the whole area
        area = 1.0 if self.force is None else sum(
            body.thickness * float(facet_measures(mesh, facets).sum())
            for body, mesh, facets in surfaces)
        loads = [(body, -surface_normal_load(mesh, facets, body.thickness) / area)
                 for body, mesh, facets in surfaces]

        def write(equations: Equations) -> None:
            for b, w in loads:
                b.body_force(equations, w, size.value)

        return LoadPart(name, write, notes=surface_notes(parts, name, self.on))
