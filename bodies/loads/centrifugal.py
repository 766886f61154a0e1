"""Centrifugal force of a body of revolution that spins about its axis."""

from collections.abc import Mapping

import numpy as np

from sparsemor.bodies.body import FloatingBody
from sparsemor.bodies.body_set import find_body, need_motion
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction, amplitude
from sparsemor.core import Equations, InputError, LoadPlugin, Part


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
