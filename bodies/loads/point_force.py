"""Point force, or a force distributed evenly over the facets of a set."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from sparsemor.bodies.loads.amplitude import NumberOrFunction, amplitude
from sparsemor.bodies.loads.part import LoadPart
from sparsemor.bodies.loads.vectors import Vector, components
from sparsemor.bodies.targets import find_target, need_field
from sparsemor.core import Equations, Part, Plugin


class PointForce(Plugin):
    """Point force at the centre of a set, distributed over its facets, with axes of the body or of
    space."""

    on: str
    """Point or set `body:set`."""
    force: Vector
    """Force, N: two components in the plane, three in space."""
    axes: Literal["body", "space"] = "space"
    """Axes of the force: `body` turns with the frame, `space` does not."""
    factor: NumberOrFunction | None = None
    """Function of time that multiplies the load; 1 by default."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        target = find_target(parts, self.on, "on")
        need_field(target, "mechanical", "on")
        body, w, f = target.body, target.mean(), amplitude(self.factor)
        F = components(body, self.force, "force")

        def write(equations: Equations) -> None:
            if self.axes == "space":
                body.space_force(equations, w, F, f)
            else:
                body.body_force(equations, np.outer(w, F), f)

        return LoadPart(name, write)
