"""Prescribed motion: chosen coordinates of an attachment follow functions of time."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.conditions import rows_on
from sparsemor.bodies.joints.plane_attachment import plane
from sparsemor.bodies.joints.plane_part import End, JointPart
from sparsemor.bodies.joints.space_attachment import spatial, unit
from sparsemor.bodies.joints.space_part import SpaceJoint
from sparsemor.bodies.loads.amplitude import Quantity
from sparsemor.bodies.targets import find_target
from sparsemor.core import InputError, Part, Plugin, Prescribed


class PrescribedMotion(Plugin):
    """Prescribed motion: displacement from the start along space axes, and rotation, over time.

    One multiplier a given coordinate: the force (N) or moment (N m) that drives it.
    """

    of: str
    """The driven point or set `body:set`."""
    x: Quantity | None = None
    """Displacement along x, m; free when not given."""
    y: Quantity | None = None
    """Displacement along y, m; free when not given."""
    z: Quantity | None = None
    """In space: displacement along z, m; free when not given."""
    angle: Quantity | None = None
    """Rotation, rad; free when not given. In space about `axis`, any number of turns; the other
    rotations are left to a joint, such as `revolute`."""
    axis: tuple[float, float, float] | None = None
    """In space: axis of the rotation (space axes), fixed in the body at the start."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart | SpaceJoint:
        if spatial(parts, [self.of]):
            return self._in_space(name, parts)
        for key in ("z", "axis"):
            if getattr(self, key) is not None:
                raise InputError("the body is plane: drop it", key)
        target = find_target(parts, self.of, "of")
        body, given = target.body, [self.x, self.y, self.angle]
        driven = [(i, f) for i, f in enumerate(given) if f is not None]
        if not driven:
            raise InputError("nothing is prescribed: give x, y or angle", "of")
        if body.immobile:
            raise InputError(f"body {body.name!r} neither moves nor deforms", "of")
        if self.angle is not None and body.elasticity is not None and len(target.nodes) < 2:
            raise InputError(f"{self.of!r} is a single point of a flexible body: it has no angle",
                             "angle")
        z = plane(target).start_position(target.mean())
        start = [z.real, z.imag, float(body.pose[2])]
        C = np.eye(3)[[i for i, _ in driven]]
        if self.angle is None:
            C = C[:, :2]
        return JointPart(name, (End(target, C),),
                         tuple(Prescribed(f, start[i]) for i, f in driven))

    def _in_space(self, name: str, parts: Mapping[str, Part]) -> SpaceJoint:
        given = {i: f for i, f in enumerate((self.x, self.y, self.z)) if f is not None}
        if not given and self.angle is None:
            raise InputError("nothing is prescribed: give x, y, z or angle", "of")
        rows = rows_on(name, self.of, parts)
        if given:
            start = rows.first.place()
            rows.meet(tuple(given), [Prescribed(f, float(start[i])) for i, f in given.items()])
        if self.angle is not None:
            axis = unit(self.axis)
            e1, e2 = across(axis)
            rows.no_relative_rotation([e1], [e2], Prescribed(self.angle), axis)
        return rows.joint()
