"""Radiation to the surroundings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from sparsemor.bodies.body_set import find_surfaces, joined_surfaces, surface_notes
from sparsemor.bodies.fem.pointwise_law import TEMPERATURE, PointwiseLaw, Response, Variable
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction
from sparsemor.bodies.mesh.plausibility import celsius_notes
from sparsemor.core import Amplitude, Effect, Equations, FloatArray, LoadPlugin, Part
from sparsemor.core.protocols import LawArrays

STEFAN_BOLTZMANN = 5.670374419e-8
"""Stefan-Boltzmann constant, W/(m^2 K^4), CODATA 2018 (exact since the SI of 2019)."""
LARGEST = 1e77
"""Temperature (K) above which the fourth power overflows: the step then ends as not finite."""


@dataclass(frozen=True, slots=True, eq=False)
class GreyBody(PointwiseLaw):
    """Radiation law q = eps sigma (T^4 - T_inf(t)^4), W/m2, of a grey surface."""

    emissivity: float
    surroundings: Amplitude
    reads: ClassVar[tuple[Variable, ...]] = (TEMPERATURE,)
    tests: ClassVar[tuple[Variable, ...]] = (TEMPERATURE,)
    degree: ClassVar[int] = 5

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        factor, T_inf = STEFAN_BOLTZMANN * self.emissivity, self.surroundings(t)
        fourth = T_inf**4 if abs(T_inf) < LARGEST else np.inf
        square = z[0] * z[0]
        return Response([factor * (square * square - fourth)],
                        {(0, 0): (4.0 * factor) * square * z[0]})

    def arrays(self) -> LawArrays:
        return LawArrays(np.array([STEFAN_BOLTZMANN * self.emissivity, LARGEST]),
                         (self.surroundings,), np.zeros((1, 2), dtype=np.int64), grey_body)


def grey_body(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """`GreyBody` at N points (`LawFunction`); numbers: eps sigma, largest temperature."""
    factor, T_inf = numbers[0], gains[0]
    fourth = T_inf**4 if abs(T_inf) < numbers[1] else np.inf
    for n in range(z.shape[1]):
        square = z[0, n] * z[0, n]
        y[0, n] = factor * (square * square - fourth)
        if len(slopes):
            slopes[0, n] = 4.0 * factor * square * z[0, n]


class Radiation(LoadPlugin):
    """Radiation: heat loss q = eps sigma (T^4 - T_inf^4) from the boundary facets (T in K)."""

    acts_on: ClassVar[Effect] = "temperature"
    levels: ClassVar[tuple[str, ...]] = ("surroundings",)

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    emissivity: float = Field(gt=0, le=1)
    """Emissivity eps."""
    surroundings: NumberOrFunction
    """Temperature of the surroundings, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        surfaces = find_surfaces(parts, self.on, "thermal")
        law = GreyBody(self.emissivity, self.surroundings.value)

        def write(equations: Equations) -> None:
            for body, facets in joined_surfaces(surfaces):
                body.law(equations, law, facets=facets)

        notes = celsius_notes(
            name, self.surroundings.value(0.0), {b.name: b.T0 for b, _, _ in surfaces},
            {b.name: b.T_ref for b, _, _ in surfaces})
        return LoadPart(name, write, surroundings=self.surroundings.value,
                        notes=(*notes, *surface_notes(parts, name, self.on)))
