"""Point force, or a force distributed evenly over the facets of a set."""

from collections.abc import Mapping
from typing import Literal

from sparsemor.bodies.body_set import Place, find_place, need_motion
from sparsemor.bodies.frames.force_items import BodyForce, SpaceForce
from sparsemor.bodies.frames.joint_items import with_torques
from sparsemor.bodies.frames.rotation import torque
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction, Vector, amplitude, components
from sparsemor.core import Amplitude, Equations, FloatArray, LoadPlugin, Part
from sparsemor.core.protocols import FrameItem

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
    of the body."""
    moved = place.displacement
    if axes == "space":
        item: FrameItem = SpaceForce(1.0, place.point, force, factor)
        vectors = moved
    else:
        item = BodyForce(force, torque(place.point[None], force[None])[0], factor)
        vectors = None if moved is None else moved @ with_torques(force[None])
    equations.frame(place.body.name, item, vectors)
