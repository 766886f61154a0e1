"""Weight of all bodies that move or deform, acting on the deformed shape, and centrifugal force of
a body of revolution that spins about its axis."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.body_set import all_bodies, find_body, need_motion
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.loads.built_load import (
    LoadPart,
    NumberOrFunction,
    Vector,
    amplitude,
    components,
)
from sparsemor.core import Body, Equations, FloatArray, InputError, LoadPlugin, Part


class Gravity(LoadPlugin):
    """Gravity: nodal forces M (1 x A^T g) and the torque of the deformed body (equations.md, 1)."""

    g: Vector | None = None
    """Acceleration, m/s^2 (space axes): two numbers in the plane, [0, -9.81] when not given; three
    in space, [0, 0, -9.81] when not given."""
    factor: NumberOrFunction | None = None
    """Function of time that multiplies g; 1 by default."""
    bodies: list[str] | None = None
    """Bodies that have weight; all when not given."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """The weight of the chosen bodies, or of all, that move or deform."""
        chosen = [find_body(parts, b, "bodies") for b in self.bodies] if self.bodies else (
            all_bodies(parts))
        f = amplitude(self.factor)
        heavy = {b.name: self._g(b) for b in chosen if b.moves or b.flexible}

        def write(equations: Equations) -> None:
            # looked up again: a later load may have replaced a body (`adjusted`)
            for b, g in heavy.items():
                find_body(parts, b, "bodies").gravity(equations, g, f)

        return LoadPart(name, write, localized=False)

    def _g(self, body: Body) -> FloatArray:
        return components(body, self.g or (*(0.0,) * (body.d - 1), -9.81), "g")


class Centrifugal(LoadPlugin):
    """Centrifugal force of an axisymmetric body that spins at a constant rate about its axis:
    density times spin^2 times the distance from the axis."""

    body: str
    """The body's name."""
    spin: float
    """Angular velocity, rad/s."""
    factor: NumberOrFunction | None = None
    """Function of time that multiplies the force, which grows with the square of the spin; 1 by
    default."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """Radial nodal forces spin^2 M x of a body of revolution; M: mass matrix of the full turn,
        x (coordinate 0): distance from the axis."""
        body = find_body(parts, self.body, "body")
        if not isinstance(body, FloatingBody) or body.mesh is None or not body.mesh.revolved:
            raise InputError(f"body {self.body!r} is not axisymmetric: others spin by their frame, "
                             "with its inertia", "body")
        need_motion(body, "body")
        assert body.mass_matrix is not None
        forces = np.zeros_like(body.X)
        forces[:, 0] = self.spin**2 * (body.mass_matrix @ body.X[:, 0])
        f = amplitude(self.factor)

        def write(equations: Equations) -> None:
            body.body_force(equations, forces, f)

        return LoadPart(name, write, localized=False)
