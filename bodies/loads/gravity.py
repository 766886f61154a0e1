"""Weight of every body that moves or deforms, on its deformed shape."""

from collections.abc import Mapping

from sparsemor.bodies.any_body import AnyBody
from sparsemor.bodies.loads.amplitude import Quantity, amplitude
from sparsemor.bodies.loads.part import LoadPart
from sparsemor.bodies.loads.vectors import Vector, components, weight
from sparsemor.bodies.spatial_body import SpatialBody
from sparsemor.bodies.targets import find_body
from sparsemor.core import Equations, FloatArray, Part, Plugin


class Gravity(Plugin):
    """Gravity: nodal forces M (1 x A^T g) and the torque of the deformed body (equations.md, 1)."""

    g: Vector | None = None
    """Acceleration, m/s^2 (space axes): two numbers in the plane, [0, -9.81] when not given; three
    in space, [0, 0, -9.81] when not given."""
    factor: Quantity | None = None
    """Function of time that multiplies g; constant 1 when not given."""
    bodies: list[str] | None = None
    """Which bodies have weight; all when not given."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        chosen = [find_body(parts, b, "bodies") for b in self.bodies] if self.bodies else [
            p for p in parts.values() if isinstance(p, AnyBody)]
        f = amplitude(self.factor)
        heavy = {b.name: self._g(b) for b in chosen if b.moves or b.elasticity is not None}

        def write(equations: Equations) -> None:
            for b, g in heavy.items():
                weight(find_body(parts, b, "bodies"), equations, g, f)

        return LoadPart(name, write, localized=False)

    def _g(self, body: AnyBody) -> FloatArray:
        down = (0.0, 0.0, -9.81) if isinstance(body, SpatialBody) else (0.0, -9.81)
        return components(body, self.g or down, "g")
