"""Weight of all bodies that move or deform, acting on the deformed shape."""

from collections.abc import Mapping

from sparsemor.bodies.body_set import all_bodies, find_body
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction, Vector, amplitude, components
from sparsemor.core import Body, Equations, FloatArray, LoadPlugin, Part


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
        chosen = [find_body(parts, b, "bodies") for b in self.bodies] if self.bodies else (
            all_bodies(parts))
        f = amplitude(self.factor)
        heavy = {b.name: self._g(b) for b in chosen if b.moves or b.flexible}

        def write(equations: Equations) -> None:
            for b, g in heavy.items():
                find_body(parts, b, "bodies").gravity(equations, g, f)

        return LoadPart(name, write, localized=False)

    def _g(self, body: Body) -> FloatArray:
        return components(body, self.g or (*(0.0,) * (body.d - 1), -9.81), "g")
