"""Convective heat exchange with a fluid."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from sparsemor.bodies.body import FloatingBody
from sparsemor.bodies.body_set import find_surfaces, surface_notes
from sparsemor.bodies.fem.pointwise_law import TEMPERATURE, PointwiseLaw, Response, Variable
from sparsemor.bodies.fem.surface import surface_load, surface_mass
from sparsemor.bodies.loads.part import LoadPart, NumberOrFunction
from sparsemor.bodies.material import Positive
from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.bodies.terms.law_functions import curve_at
from sparsemor.core import Amplitude, Effect, Equations, FloatArray, LoadPlugin, Part
from sparsemor.core.protocols import LawArrays


@dataclass(frozen=True, slots=True, eq=False)
class Film(PointwiseLaw):
    """Heat flux (h(T) - h_0) (T - T_fluid(t)), W/m2, of a film coefficient that depends on the
    temperature of the surface, beyond its constant part h_0."""

    h: TemperatureCurve
    h_0: float
    fluid: Amplitude
    reads: ClassVar[Sequence[Variable]] = (TEMPERATURE,)
    tests: ClassVar[Sequence[Variable]] = (TEMPERATURE,)

    @property
    def degree(self) -> int:
        return self.h.degree + 2

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        (h, slope), rise = self.h.at(z[0]), z[0] - self.fluid(t)
        change = h - self.h_0
        return Response([change * rise], {(0, 0): slope * rise + change})

    def arrays(self) -> LawArrays:
        return LawArrays(np.concatenate([[self.h_0], self.h.numbers]), (self.fluid,),
                         np.zeros((1, 2), dtype=np.int64), film, (curve_at,))


def film(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """`Film` at N points (`LawFunction`); numbers: h_0, h."""
    for n in range(z.shape[1]):
        h, slope = curve_at(numbers, 1, z[0, n])
        rise = z[0, n] - gains[0]
        y[0, n] = (h - numbers[0]) * rise
        if len(slopes):
            slopes[0, n] = slope * rise + h - numbers[0]


class Convection(LoadPlugin):
    """Convection: heat flux q = h (T_fluid - T) over the boundary facets of each set."""

    acts_on: ClassVar[Effect] = "temperature"
    levels: ClassVar[tuple[str, ...]] = ("temperature",)

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    film: Positive
    """Film coefficient h, W/(m^2 K), a number or a function of the temperature of the surface."""
    temperature: NumberOrFunction
    """Temperature of the fluid, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        loads = []
        for body, mesh, facets in find_surfaces(parts, self.on, "thermal"):
            h_0 = self._constant(body)
            h = h_0 * body.thickness
            loads.append((body, facets, h_0, h * surface_load(mesh, facets, 1.0),
                          surface_mass(mesh, facets, h)))

        def write(equations: Equations) -> None:
            for body, facets, h_0, w, S in loads:
                body.heat_load(equations, w, self.temperature.value, S)
                if isinstance(self.film, TemperatureCurve):
                    body.law(equations, Film(self.film, h_0, self.temperature.value),
                             facets=facets)

        return LoadPart(name, write, surroundings=self.temperature.value,
                        notes=surface_notes(parts, name, self.on))

    def _constant(self, body: FloatingBody) -> float:
        """Film coefficient at the reference temperature of the body."""
        if isinstance(self.film, TemperatureCurve):
            assert body.T_ref is not None
            return float(self.film.at(np.array([body.T_ref.mean()]))[0][0])
        return self.film
