"""Natural convection from a hot surface: a pointwise law of ten lines in a package of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sparsemor.bodies import TEMPERATURE, LoadPart, PointwiseLaw, Response, find_surfaces
from sparsemor.core import Equations, FloatArray, LoadPlugin, Part


@dataclass(frozen=True)
class NaturalConvection(PointwiseLaw):
    """q = C (T - T_air)^(5/4), W/m2; zero below T_air."""

    C: float
    T_air: float
    reads = tests = (TEMPERATURE,)
    degree = 3

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        root = np.maximum(z[0] - self.T_air, 0.0) ** 0.25
        return Response([self.C * root * (z[0] - self.T_air)], {(0, 0): 1.25 * self.C * root})


class CalmAir(LoadPlugin):
    """Natural convection of hot surfaces in calm air."""

    on: list[str]
    """Surfaces `body:set`."""
    C: float
    """Coefficient C, W/(m^2 K^(5/4))."""
    temperature: float
    """Temperature of the air, K."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        surfaces = find_surfaces(parts, self.on, "thermal")
        law = NaturalConvection(self.C, self.temperature)

        def write(equations: Equations) -> None:
            for body, _, facets in surfaces:
                body.law(equations, law, facets=facets)

        return LoadPart(name, write, surroundings=lambda t: self.temperature)
