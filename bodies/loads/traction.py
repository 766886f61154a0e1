"""Prescribed surface force per area, rotating with the body or fixed in space."""

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from sparsemor.bodies.body_set import find_surfaces, surface_notes
from sparsemor.bodies.fem.surface import surface_load
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction, Vector, amplitude, components
from sparsemor.core import Equations, LoadPlugin, Part


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
