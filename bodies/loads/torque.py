"""Moment on a body, or on the mean rotation of a set of a flexible body."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from sparsemor.bodies.body_set import find_place, need_motion
from sparsemor.bodies.frames.force_items import Moment
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction, amplitude
from sparsemor.core import Equations, InputError, LoadPlugin, Part


class Torque(LoadPlugin):
    """Torque: a moment on the mean rotation of a set, with axes of the body or of space.

    On a rigid body the set does not matter. On a flexible one it is a distribution of nodal forces
    whose power is the moment times the rate of the mean rotation (by least squares) of the set.
    """

    on: str
    """Point or set `body:set`; on a flexible body two or more points, in space not on one line."""
    torque: float | tuple[float, float, float]
    """Moment, N m: in the plane a number, counterclockwise; in space three components."""
    axes: Literal["body", "space"] = "space"
    """In space, axes of the moment: `body` turns with the frame, `space` does not."""
    factor: NumberOrFunction | None = None
    """Function of time that multiplies the load; 1 by default."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        place = find_place(parts, self.on, "on")
        body = place.body
        need_motion(body, "on")
        moment = np.atleast_1d(np.array(self.torque, dtype=np.float64))
        if len(moment) != 2 * body.d - 3:
            need = "one number" if body.d == 2 else "three components"
            raise InputError(f"body {body.name!r} is {'plane' if body.d == 2 else 'in space'}: "
                             f"give {need} (got {self.torque})", "torque")
        turning = place.turning("on")
        item = Moment(moment, amplitude(self.factor), turning is not None,
                      body.d == 3 and self.axes == "space")

        def write(equations: Equations) -> None:
            equations.frame(body.name, item, turning)

        return LoadPart(name, write)
