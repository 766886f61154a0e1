"""Weight of every body that moves or deforms, on its deformed shape."""

from collections.abc import Mapping, Sequence
from typing import Annotated

from pydantic import Field

from sparsemor.bodies.body_part import PlanarBody
from sparsemor.bodies.loads.amplitude import Quantity, amplitude
from sparsemor.bodies.loads.part import LoadPart
from sparsemor.bodies.targets import find_body
from sparsemor.core.layout import Layout
from sparsemor.core.plugin import Plugin
from sparsemor.core.protocols import Part, Term


class Gravity(Plugin):
    """Nodal forces M (1 x A^T g) with the torque of the deformed position (equations.md, 1)."""

    g: Annotated[tuple[float, float], Field()] = (0.0, -9.81)
    """Acceleration, m/s^2 (space axes)."""
    factor: Quantity | None = None
    """Function of time that multiplies g; constant 1 when not given."""
    bodies: list[str] | None = None
    """Which bodies have weight; all when not given."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        chosen = [find_body(parts, b, "bodies") for b in self.bodies] if self.bodies else [
            p for p in parts.values() if isinstance(p, PlanarBody)]
        heavy = [b.name for b in chosen if b.moves or b.elasticity is not None]
        g, f = complex(*self.g), amplitude(self.factor)

        def make(layout: Layout) -> Sequence[Term]:
            return [find_body(parts, b, "bodies").gravity(layout, g, f) for b in heavy]

        return LoadPart(name, make, localized=False)
