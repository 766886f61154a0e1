"""Material laws that depend on temperature, less their part with constant properties.

Conductivity, specific heat and elastic stress are split into their part with the properties at the
reference temperature, which has constant matrices, and the rest, which is a pointwise law:

    (k(T) - k_0) grad T . grad phi,     rho (c(T) - c_0) T' phi,
    [(E(T)/E_0 - 1) C_0 : eps - (beta(T) - beta_0) (T - T_ref) I] : grad v,

where beta = E alpha / (1 - nu) in plane stress and E alpha / (1 - 2 nu) otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sparsemor.bodies.fem.elasticity import Law, Model, expansion_factor, law
from sparsemor.bodies.fem.pointwise_law import (
    TEMPERATURE,
    TEMPERATURE_RATE,
    PointwiseLaw,
    Response,
    StressLaw,
    Variable,
    displacement_gradient,
    temperature_gradient,
)
from sparsemor.bodies.material import Region, curves
from sparsemor.bodies.terms.law_functions import (
    conduction,
    curve_at,
    expansion,
    numbers_of,
    softening,
    softening_pairs,
    stored_heat,
)
from sparsemor.bodies.terms.nonlinear_strains import NonlinearStrains
from sparsemor.core import FloatArray, LawArrays, TemperatureProperty


@dataclass(frozen=True, slots=True, eq=False)
class Departure:
    """A property less its value at the reference temperature, p(T) - p(T_ref)."""

    of: TemperatureProperty
    reference: float

    def at(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values and derivatives at temperatures T, K."""
        values, slopes = self.of.at(T)
        return values - self.reference, slopes


def _arrays(
    function: Callable[..., None], pairs: Sequence[tuple[int, int]], first: Sequence[float],
    *of: TemperatureProperty | float
) -> LawArrays | None:
    """A law with its first numbers and those of its properties; None where one has none."""
    found = [n for n in map(numbers_of, of) if n is not None]
    if len(found) < len(of):
        return None
    return LawArrays(np.concatenate([first, *found]), (), np.array(pairs, dtype=np.int64),
                     function, (curve_at,))


@dataclass(frozen=True, slots=True, eq=False)
class Conduction:
    """Heat conduction (k(T) - k_0) grad T in d dimensions."""

    k: Departure
    d: int

    @property
    def reads(self) -> Sequence[Variable]:
        return (TEMPERATURE, *temperature_gradient(self.d))

    @property
    def tests(self) -> Sequence[Variable]:
        return temperature_gradient(self.d)

    @property
    def degree(self) -> int:
        return self.k.of.degree

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        T, *gradient = z
        k, slope = self.k.at(T)
        by_T = {(i, 0): slope * g for i, g in enumerate(gradient)}
        return Response([k * g for g in gradient],
                        {**by_T, **{(i, i + 1): k for i in range(self.d)}})

    def arrays(self) -> LawArrays | None:
        pairs = [pair for i in range(self.d) for pair in ((i, 0), (i, i + 1))]
        return _arrays(conduction, pairs, [self.k.reference], self.k.of)


@dataclass(frozen=True, slots=True, eq=False)
class StoredHeat:
    """Heat storage rho (c(T) - c_0) T'."""

    rho: float
    c: Departure
    reads: ClassVar[Sequence[Variable]] = (TEMPERATURE, TEMPERATURE_RATE)
    tests: ClassVar[Sequence[Variable]] = (TEMPERATURE,)

    @property
    def degree(self) -> int:
        return self.c.of.degree + 2

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        T, rate = z
        c, slope = self.c.at(T)
        stored = self.rho * c
        return Response([stored * rate], {(0, 0): self.rho * slope * rate, (0, 1): stored})

    def arrays(self) -> LawArrays | None:
        return _arrays(stored_heat, [(0, 0), (0, 1)], [self.rho, self.c.reference], self.c.of)


@dataclass(frozen=True, slots=True, eq=False)
class Softening:
    """Stress (E(T)/E_0 - 1) C_0 : eps of the elastic modulus in d dimensions; law: constants of C_0
    at E_0 = E.reference."""

    E: Departure
    law: Law
    d: int
    linear: ClassVar[bool] = True

    @property
    def reads(self) -> Sequence[Variable]:
        return (TEMPERATURE, *displacement_gradient(self.d))

    @property
    def tests(self) -> Sequence[Variable]:
        return displacement_gradient(self.d)

    @property
    def degree(self) -> int:
        return self.E.of.degree

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        d, (T, *g) = self.d, z
        value, slope = self.E.at(T)
        e, by_T = value / self.E.reference, slope / self.E.reference
        lam, mu = self.law.lam, self.law.mu
        spread = lam * sum(g[i * d + i] for i in range(d))
        y: list[FloatArray] = []
        found: dict[tuple[int, int], FloatArray | float] = {}
        normal, shear, direct = lam * e, mu * e, (lam + 2 * mu) * e
        for i in range(d):
            for j in range(d):
                n = i * d + j
                stress = mu * (g[n] + g[j * d + i])
                if i == j:
                    stress = stress + spread
                    for k in range(d):
                        found[n, 1 + k * d + k] = direct if k == i else normal
                else:
                    found[n, 1 + n] = found[n, 1 + j * d + i] = shear
                y.append(e * stress)
                found[n, 0] = by_T * stress
        return Response(y, found)

    def arrays(self) -> LawArrays | None:
        return _arrays(softening, softening_pairs(self.d), [
            self.d, self.E.reference, self.law.lam, self.law.mu], self.E.of)


@dataclass(frozen=True, slots=True, eq=False)
class Expansion:
    """Thermal stress -(beta(T) - beta_0) (T - T_ref) I in d dimensions, where beta = factor E(T)
    alpha(T).

    E, alpha: functions of temperature or constants; beta_0, Pa/K; reference: T_ref, K.
    """

    E: TemperatureProperty | float
    alpha: TemperatureProperty | float
    factor: float
    beta_0: float
    reference: float
    d: int
    reads: ClassVar[Sequence[Variable]] = (TEMPERATURE,)
    linear: ClassVar[bool] = True

    @property
    def tests(self) -> Sequence[Variable]:
        return [v for i, v in enumerate(displacement_gradient(self.d)) if i % (self.d + 1) == 0]

    @property
    def degree(self) -> int:
        return sum(p.degree for p in (self.E, self.alpha) if isinstance(p, TemperatureProperty)) + 1

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        (T,) = z
        rise = T - self.reference
        (E, E_T), (alpha, alpha_T) = _evaluated(self.E, T), _evaluated(self.alpha, T)
        change = self.factor * E * alpha - self.beta_0
        stress = -change * rise
        slope = -self.factor * (E_T * alpha + E * alpha_T) * rise - change
        return Response([stress] * self.d, {(i, 0): slope for i in range(self.d)})

    def arrays(self) -> LawArrays | None:
        E = numbers_of(self.E)
        return None if E is None else _arrays(
            expansion, [(i, 0) for i in range(self.d)],
            [self.factor, self.beta_0, self.reference, 4.0 + len(E)], self.E, self.alpha)


def _evaluated(
    of: TemperatureProperty | float, T: FloatArray
) -> tuple[FloatArray | float, FloatArray | float]:
    return (of, 0.0) if isinstance(of, int | float) else of.at(T)


def heat_laws(region: Region, d: int) -> list[PointwiseLaw]:
    """Conduction and heat storage of a material beyond constant properties."""
    found, c = curves(region.material), region.constants
    laws: list[PointwiseLaw] = []
    if "k" in found and c.k is not None:
        laws.append(Conduction(Departure(found["k"], c.k), d))
    if "c" in found and c.c is not None:
        laws.append(StoredHeat(c.rho, Departure(found["c"], c.c)))
    return laws


def stress_laws(
    region: Region, model: Model, d: int, reference: float, nonlinear: bool, heated: bool
) -> list[StressLaw]:
    """Elastic and thermal stress of a material beyond constant properties and linear strains;
    reference: T_ref, K; heated: True if temperatures of the body differ from it."""
    found, constants = curves(region.material), region.constants
    at_reference, E, alpha = law(constants, model), region.material.E, region.material.alpha
    laws: list[StressLaw] = []
    if nonlinear and E is not None and constants.E is not None and constants.nu is not None:
        return [NonlinearStrains(
            at_reference, d, E, constants.E, alpha, expansion_factor(constants.nu, model),
            reference, heated and ("E" in found or alpha != 0.0))]
    if "E" in found and constants.E is not None:
        laws.append(Softening(Departure(found["E"], constants.E), at_reference, d))
    if E is not None and constants.nu is not None and alpha != 0.0 and not (
            found.keys().isdisjoint({"E", "alpha"})):
        laws.append(Expansion(E, alpha, expansion_factor(constants.nu, model), at_reference.beta,
                              reference, d))
    return laws
