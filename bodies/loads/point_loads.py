"""Point force, or a force distributed evenly over the facets of a set, and moment on a body or on
the mean rotation of a set."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from sparsemor.bodies.body_set import Place, find_place, need_motion
from sparsemor.bodies.frames.applied_forces import BodyForce, Moment, SpaceForce
from sparsemor.bodies.frames.mean_displacement_and_rotation import with_torques
from sparsemor.bodies.frames.rotation import torque
from sparsemor.bodies.loads.built_load import (
    LoadPart,
    NumberOrFunction,
    Vector,
    amplitude,
    components,
)
from sparsemor.core import Amplitude, Equations, FloatArray, InputError, LoadPlugin, Part
from sparsemor.core.protocols.body_frame import FrameItem

Axes = Literal["body", "space"]


class PointForce(LoadPlugin):
    """Point force at the centre of a set, distributed over its facets, with axes of the body or of
    space."""

    on: str
    """Point or set `body:set`."""
    force: Vector
    """Force, N: two components in the plane, three in space."""
    axes: Axes = "space"
    """Axes of the force: `body` turns with the frame, `space` does not."""
    factor: NumberOrFunction | None = None
    """Function of time that multiplies the load; 1 by default."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """The force at the centre of the set."""
        place = find_place(parts, self.on, "on")
        need_motion(place.body, "on")
        f = amplitude(self.factor)
        F = components(place.body, self.force, "force")

        def write(equations: Equations) -> None:
            write_point_force(equations, place, F, f, self.axes)

        return LoadPart(name, write)


def write_point_force(
    equations: Equations, place: Place, force: FloatArray, factor: Amplitude, axes: Axes = "space"
) -> None:
    """Adds a force (d,), N, times a function of time at the centre of a set, with axes of space or
    of the body. displacement (n, d): of the centre by the unknown displacements, None on a rigid
    body. In axes of the body the torque about its frame origin is constant, and the functionals are
    force . u and u x force."""
    moved = place.displacement
    if axes == "space":
        item: FrameItem = SpaceForce(1.0, place.point, force, factor)
        vectors = moved
    else:
        item = BodyForce(force, torque(place.point[None], force[None])[0], factor)
        vectors = None if moved is None else moved @ with_torques(force[None])
    equations.frame(place.body.name, item, vectors)


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
        """The moment on a rigid body, or on the mean rotation of a set of a flexible one; turning:
        derivatives of that rotation by the unknown displacements, None for none."""
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
