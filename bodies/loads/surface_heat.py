"""Heat exchange of a surface: radiation to the surroundings, and convection with a fluid."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from sparsemor.bodies.body_set import find_surfaces, joined_surfaces, surface_notes
from sparsemor.bodies.fem.integrals import surface_load, surface_mass
from sparsemor.bodies.fem.pointwise_law import TEMPERATURE, PointwiseLaw, Response, Variable
from sparsemor.bodies.floating_body import FloatingBody
from sparsemor.bodies.loads.built_load import LoadPart, NumberOrFunction
from sparsemor.bodies.material import Positive
from sparsemor.bodies.mesh.mesh_checks_and_repairs import celsius_notes
from sparsemor.bodies.temperature_curve import TemperatureCurve
from sparsemor.bodies.terms.law_functions import curve_at
from sparsemor.core import Amplitude, Effect, Equations, FloatArray, LoadPlugin, Part
from sparsemor.core.protocols.term import LawArrays

STEFAN_BOLTZMANN = 5.670374419e-8
"""Stefan-Boltzmann constant, W/(m^2 K^4), CODATA 2018 (exact since the SI of 2019)."""
LARGEST = 1e77
"""Temperature (K) above which the fourth power overflows: the step then ends as not finite."""


@dataclass(frozen=True, slots=True, eq=False)
class GreyBody(PointwiseLaw):
    """Radiation law q = eps sigma (T^4 - T_inf(t)^4), W/m2, of a grey surface: heat that leaves the
    body, for the surface temperature z[0], K, with its derivative. degree 5: of the fourth power
    times a test function. Beyond `LARGEST` the fourth power would raise an error: it is infinite.
    arrays: the same law for compiled steps, the function `grey_body`."""

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
    """Radiation eps sigma (T^4 - T_inf^4), W/m2, at N points (`GreyBody`), a `LawFunction`;
    numbers: eps sigma, largest temperature, K; gains: T_inf, K; z (1, N): T, K; y (1, N): heat
    flux; slopes: its derivative, no rows where it is not wanted; x: not used."""
    factor, T_inf = numbers[0], gains[0]
    fourth = T_inf**4 if abs(T_inf) < numbers[1] else np.inf
    for n in range(z.shape[1]):
        square = z[0, n] * z[0, n]
        y[0, n] = factor * (square * square - fourth)
        if len(slopes):
            slopes[0, n] = 4.0 * factor * square * z[0, n]


class Radiation(LoadPlugin):
    """Radiation: heat loss q = eps sigma (T^4 - T_inf^4) from the boundary facets (T in K)."""

    acts_on: ClassVar[Effect] = "temperature"  # a rigid-body pre-simulation leaves it out
    # options whose function of time is no amplitude, which would be 0 without the load
    levels: ClassVar[tuple[str, ...]] = ("surroundings",)

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    emissivity: float = Field(gt=0, le=1)
    """Emissivity eps."""
    surroundings: NumberOrFunction
    """Temperature of the surroundings, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """The law of a grey body on the facets of the surfaces, for each body once (joined), with
        warnings about temperatures that look like degrees Celsius."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Film(PointwiseLaw):
    """Heat flux (h(T) - h_0) (T - T_fluid(t)), W/m2, that leaves the body, of a film coefficient
    that depends on the temperature z[0] of the surface, K, beyond its constant part h_0, W/(m2 K),
    which has a constant matrix; with its derivative by T. arrays: the same law for compiled
    steps."""

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

    acts_on: ClassVar[Effect] = "temperature"  # a rigid-body pre-simulation leaves it out
    # options whose function of time is no amplitude, which would be 0 without the load
    levels: ClassVar[tuple[str, ...]] = ("temperature",)

    on: Annotated[list[str], Field(min_length=1)]
    """Surfaces `body:set`."""
    film: Positive
    """Film coefficient h, W/(m^2 K), a number or a function of the temperature of the surface."""
    temperature: NumberOrFunction
    """Temperature of the fluid, K, a number or a function of time."""

    def build(self, name: str, parts: Mapping[str, Part]) -> LoadPart:
        """Linear exchange with the constant coefficient h_0, that at the reference temperature, and
        the law of what of it depends on temperature. S (N, N), w (N,): convection matrix, W/K, and
        its product with temperatures 1."""
        loads = []
        for body, mesh, facets in find_surfaces(parts, self.on, "thermal"):
            h_0 = self._constant(body)
            h = h_0 * body.thickness
            # nodal heats w T_fluid - S T with the coefficient h_0
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
