"""Prescribed motion of a point: displacements and rotation as functions of time."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.frames.rotation import across
from sparsemor.bodies.joints.built_joint import JointPart
from sparsemor.bodies.joints.constraint_conditions import conditions_on
from sparsemor.bodies.joints.joint_sides import unit
from sparsemor.bodies.loads.built_load import NumberOrFunction
from sparsemor.core import InputError, JointPlugin, Part
from sparsemor.core.protocols.time_function import Prescribed


class PrescribedMotion(JointPlugin):
    """Prescribed motion: displacement from the initial position along space axes, and rotation, as
    functions of time.

    One multiplier per prescribed coordinate: the force (N) or moment (N m) that enforces it.
    """

    of: str
    """Point or set `body:set` whose motion is prescribed."""
    x: NumberOrFunction | None = None
    """Displacement along x, m; free when not given."""
    y: NumberOrFunction | None = None
    """Displacement along y, m; free when not given."""
    z: NumberOrFunction | None = None
    """In space: displacement along z, m; free when not given."""
    angle: NumberOrFunction | None = None
    """Rotation, rad; free when not given. In space about `axis`, any number of turns; the other
    rotations are constrained by a joint, such as `revolute`."""
    axis: tuple[float, float, float] | None = None
    """In space: axis of the rotation (space axes), fixed in the body at the start."""

    def build(self, name: str, parts: Mapping[str, Part]) -> JointPart:
        """Constraints of the prescribed components, as displacements from the start, and of the
        angle. driven: number of the axis -> displacement as a function of time; Prescribed:
        function of time plus the value at the start."""
        conditions = conditions_on(name, self.of, parts)
        d, side = conditions.d, conditions.first
        for key in ("z", "axis") if d == 2 else ():
            if getattr(self, key) is not None:
                raise InputError("the body is plane: drop it", key)
        driven = {i: f for i, f in enumerate((self.x, self.y, self.z)) if f is not None}
        if not driven and self.angle is None:
            raise InputError(f"nothing is prescribed: give {'x, y' if d == 2 else 'x, y, z'} or "
                             "angle", "of")
        if driven:
            start = side.place()
            conditions.meet(np.eye(d)[list(driven)],
                            [Prescribed(f, float(start[i])) for i, f in driven.items()])
        if self.angle is not None and d == 2:
            conditions.couple_rotations(target=Prescribed(self.angle, float(side.pose[2])))
        elif self.angle is not None:
            axis = unit(self.axis, d)
            e1, e2 = across(axis)
            conditions.no_relative_rotation([e1], [e2], Prescribed(self.angle), axis)
        return conditions.joint()
