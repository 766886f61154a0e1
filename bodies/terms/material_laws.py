"""Material laws that depend on temperature, less their part with constant properties.

Conductivity, specific heat and elastic stress are split into their part with the properties at the
reference temperature, which has constant matrices, and the rest, which is a pointwise law:

    (k(T) - k_0) grad T . grad phi,     rho e' phi,     e = integral of c(T) - c_0 over T,
    [(E(T)/E_0 - 1) C_0 : eps - (beta(T) - beta_0) (T - T_ref) I] : grad v,

where e' is the formula of the integrator's rate, applied to e in the place of T: differences of
heat content are conserved in every step, also across a peak of c by latent heat, which c(T) T' at
the end of a step is not. beta = E alpha / (1 - nu) in plane stress and E alpha / (1 - 2 nu)
otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sparsemor.bodies.fem.elasticity import Law, Model, expansion_factor, law
from sparsemor.bodies.fem.pointwise_law import (
    TEMPERATURE,
    TEMPERATURE_BEND,
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
    integral_at,
    numbers_of,
    softening,
    softening_pairs,
    stored_heat,
    with_integrals,
)
from sparsemor.bodies.terms.nonlinear_strains import NonlinearStrains, evaluated
from sparsemor.core import FloatArray, TemperatureProperty
from sparsemor.core.protocols.step_amplitude import Stepping, present_step
from sparsemor.core.protocols.term import LawArrays

STEEP = 2.0
"""Ratio of greatest to least specific heat above which a step may jump over a peak."""
_INTERVALS = 500
"""Number of intervals of which the mean specific heats are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Departure:
    """A material property less its value at the reference temperature, p(T) - p(T_ref), of which
    the pointwise laws consist: the rest has constant matrices. of: the property p; reference:
    p(T_ref).
    """

    of: TemperatureProperty
    reference: float

    def at(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values and derivatives at temperatures T, K."""
        values, slopes = self.of.at(T)
        return values - self.reference, slopes

    def integral(self, T: FloatArray) -> FloatArray:
        """Integral of p - p(T_ref) up to T, K, from a constant lower limit, which cancels where
        heat contents are subtracted."""
        return self.of.integral(T) - self.reference * T

    def steep(self) -> bool:
        """True if means over small intervals differ by more than a factor `STEEP`."""
        low, high = self.of.limits
        if not (low < high and np.isfinite(high - low)):
            return low < high
        T = np.linspace(low, high, _INTERVALS + 1)
        means = np.diff(self.integral(T) + self.reference * T) / np.diff(T)
        return bool(means.max() > STEEP * means.min())


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
class Conduction(PointwiseLaw):
    """Heat conduction (k(T) - k_0) grad T in d dimensions, beyond that of the constant k_0.

    k: k(T) - k_0 with its derivative (`at`). z: T and its d gradients; the response has the d
    components of the flux and derivatives (component, variable). arrays: the same law for compiled
    steps, `pairs` in the order in which law_functions.conduction writes derivatives.
    """

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


@dataclass(frozen=True, slots=True)
class FirstStep:
    """1 in the first step of a run, of h, s, and 0 later."""

    h: float

    def __call__(self, t: float) -> float:
        return float(t <= self.h * (1.0 + 1e-9))


@dataclass(frozen=True, slots=True, eq=False)
class StoredHeat(PointwiseLaw):
    """Heat storage rho e', e = integral of c(T) - c_0 over T.

    By the rate T' and the second difference T'' of the temperature (`StepFormula`) in a step of h,
    the earlier temperatures are T_0 = T - h T' + h^2 T''/2 and T_1 = 2 T_0 - T + h^2 T'', and

        e' = (e - e_0)/h  (BDF1),      e' = (3 e - 4 e_0 + e_1)/(2 h)  (BDF2)

    stepping: the steps of a run, which replace it (`Stepping.over`); its `differences`: number of
    earlier temperatures in the integrator's formula. For 0, another formula, and where no step is
    being solved, as at the start of a run, e' = (c(T) - c_0) T'. In the first step e_1 is e_0 less
    h times that, since T_1 was none of its temperatures. Its h: size of compiled steps, s; others
    have that of the present step.

    Where BDF2 begins anew in the middle of a run (`time.control`), T_1 is none of its temperatures
    either, and T' says little about the heat content near a peak. For a capacity with `peak`, the
    whole content H = c_0 T + e is there stored by BDF1, e' = (H - H_0)/h - c_0 T', which is
    conserved, and exact for a constant power. One such step has an error of second order.
    """

    rho: float
    c: Departure
    stepping: Stepping = Stepping(0.0, 0.0)
    peak: bool = False
    reads: ClassVar[Sequence[Variable]] = (TEMPERATURE, TEMPERATURE_RATE, TEMPERATURE_BEND)
    tests: ClassVar[Sequence[Variable]] = (TEMPERATURE,)

    @property
    def degree(self) -> int:
        return self.c.of.degree + 2

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        """Heat stored per volume and time, W/m3, and its derivatives by T and T', for constant T_0
        and T_1, the temperatures of earlier steps, one and two steps of h before.

        self.c: c(T) - c_0, with its integral e; stepping.differences: how many of these
        temperatures the integrator's formula has, 1 (BDF1) or 2 (BDF2; in the first step T_1 was
        none, and e_0 - e_1 = (c(T_0) - c_0) (T_0 - T_1)); step: the present one, which `begins`
        where BDF2 starts anew; peak: c has one, as of latent heat.
        """
        T, rate, bend = z  # second difference 2 (T_0 - T + h T')/h^2
        c, slope = self.c.at(T)
        stored, step = self.rho * c, present_step()
        h, earlier = step.h, self.stepping.differences
        if not earlier or not h:  # another formula, or no step: e' = (c - c_0) T'
            return Response([stored * rate], {(0, 0): self.rho * slope * rate, (0, 1): stored})
        T_0 = T - h * rate + 0.5 * h * h * bend  # one step before, T_1 two
        past = self.c.integral(T_0)
        change, gain = self.c.integral(T) - past, 1.0
        if earlier == 2 and self.peak and step.begins:
            # BDF1 of the whole content H = c_0 T + e, less c_0 T' of the constant capacity matrix
            c_0 = self.c.reference
            return Response([self.rho / h * (change + c_0 * (T - T_0 - h * rate))],
                            {(0, 0): self.rho / h * (c + c_0), (0, 1): -self.rho * c_0})
        if earlier == 2:
            T_1 = 2.0 * T_0 - T + h * h * bend
            first = FirstStep(h)(t)
            gone = self.c.at(T_0)[0] * (T_0 - T_1) if first else past - self.c.integral(T_1)
            change, gain = 1.5 * change - 0.5 * gone, 1.5
        return Response([self.rho / h * change], {(0, 0): gain / h * stored})

    def arrays(self) -> LawArrays | None:
        made = _arrays(stored_heat, [(0, 0), (0, 1)], [
            self.rho, self.c.reference, float(self.stepping.differences), self.stepping.h],
            self.c.of)
        return None if made is None else replace(
            made, amplitudes=(FirstStep(self.stepping.h),), calls=(curve_at, integral_at),
            step=self.stepping.h,
            numbers=np.concatenate([made.numbers[:4], with_integrals(made.numbers[4:])]))


@dataclass(frozen=True, slots=True, eq=False)
class Softening(StressLaw):
    """Stress (E(T)/E_0 - 1) C_0 : eps of the elastic modulus in d dimensions; law: constants of C_0
    at E_0 = E.reference."""

    E: Departure
    law: Law
    d: int
    linear: ClassVar[bool] = True  # in the displacements

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
        """Stress (E(T) / E_0 - 1) (lam tr(eps) I + 2 mu eps) (d d), Pa, row by row, and its
        derivatives by T and grad u; self.E: E(T) - E_0 with its derivative (`at`), reference
        E_0."""
        d, (T, *g) = self.d, z  # g: grad u, row by row
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
class Expansion(StressLaw):
    """Thermal stress -(beta(T) - beta_0) (T - T_ref) I in d dimensions, where beta = factor E(T)
    alpha(T).

    E, Pa, alpha, 1/K: functions of temperature or constants; beta_0, Pa/K; reference: T_ref, K. It
    is isotropic, so that it is tested by the d gradients du_i/dx_i alone, whose d stresses are
    equal. arrays: the same law for compiled steps; its numbers: those of E begin after four others.
    """

    E: TemperatureProperty | float
    alpha: TemperatureProperty | float
    factor: float
    beta_0: float
    reference: float
    d: int
    reads: ClassVar[Sequence[Variable]] = (TEMPERATURE,)
    linear: ClassVar[bool] = True  # in the displacements

    @property
    def tests(self) -> Sequence[Variable]:
        return [v for i, v in enumerate(displacement_gradient(self.d)) if i % (self.d + 1) == 0]

    @property
    def degree(self) -> int:
        return sum(p.degree for p in (self.E, self.alpha) if isinstance(p, TemperatureProperty)) + 1

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        """The d equal normal stresses, Pa, and their derivatives by T."""
        (T,) = z
        rise = T - self.reference
        (E, E_T), (alpha, alpha_T) = evaluated(self.E, T), evaluated(self.alpha, T)
        change = self.factor * E * alpha - self.beta_0
        stress = -change * rise
        slope = -self.factor * (E_T * alpha + E * alpha_T) * rise - change
        return Response([stress] * self.d, {(i, 0): slope for i in range(self.d)})

    def arrays(self) -> LawArrays | None:
        E = numbers_of(self.E)
        return None if E is None else _arrays(
            expansion, [(i, 0) for i in range(self.d)],
            [self.factor, self.beta_0, self.reference, 4.0 + len(E)], self.E, self.alpha)


def heat_laws(region: Region, d: int) -> list[PointwiseLaw]:
    """Conduction and heat storage of a material beyond constant properties."""
    found, c = curves(region.material), region.constants
    laws: list[PointwiseLaw] = []
    if "k" in found and c.k is not None:
        laws.append(Conduction(Departure(found["k"], c.k), d))
    if "c" in found and c.c is not None:
        of = Departure(found["c"], c.c)
        laws.append(StoredHeat(c.rho, of, peak=of.steep()))
    return laws


def stress_laws(
    region: Region, model: Model, d: int, reference: float, nonlinear: bool, heated: bool
) -> list[StressLaw]:
    """Elastic and thermal stress of a material beyond constant properties and linear strains, whose
    constants at T_ref have constant matrices; reference: T_ref, K; nonlinear: Green-Lagrange
    strains, all stress in one law; heated: True if temperatures of the body differ from T_ref.
    found: properties that are functions of temperature, by name."""
    found, constants = curves(region.material), region.constants
    at_reference, p = law(constants, model), region.material.properties()
    E, alpha = p.E, p.alpha
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
