"""Stress of Green-Lagrange strains (St. Venant-Kirchhoff material), less its linear part.

With the displacement gradient G in the body frame, F = I + G and E = (G + G^T + G^T G) / 2, the
first Piola-Kirchhoff stress is

    P = F S,    S = E(T)/E_0 (lam tr(E) I + 2 mu E) - beta(T) (T - T_ref) I.

The stress of small strains with the properties at the reference temperature has constant matrices
(fem/elasticity.py); the rest is a pointwise law:

    [P - lam tr(eps) I - 2 mu eps + beta_0 (T - T_ref) I] : grad v,    eps = (G + G^T) / 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sparsemor.bodies.fem.elasticity import Law
from sparsemor.bodies.fem.pointwise_law import (
    TEMPERATURE,
    GreenLagrange,
    Response,
    StressLaw,
    Variable,
    displacement_gradient,
)
from sparsemor.bodies.terms.law_functions import curve_at, numbers_of
from sparsemor.core import FloatArray, TemperatureProperty
from sparsemor.core.protocols.term import LawArrays

Property = TemperatureProperty | float


@dataclass(frozen=True, slots=True, eq=False)
class NonlinearStrains(StressLaw):
    """First Piola-Kirchhoff stress of Green-Lagrange strains less the linear stress, in d
    dimensions.

    law: constants lam, mu, Pa, and beta_0, Pa/K, of the linear stress. E, Pa, and alpha, 1/K:
    functions of temperature or constants, with beta = factor E alpha; E_0: E at the reference
    temperature T_ref (`reference`), K. heated: True if the stress depends on temperature.
    """

    law: Law
    d: int
    E: Property
    E_0: float
    alpha: Property
    factor: float
    reference: float
    heated: bool
    linear: ClassVar[bool] = False

    @property
    def reads(self) -> Sequence[Variable]:
        return (*((TEMPERATURE,) if self.heated else ()), *displacement_gradient(self.d))

    @property
    def tests(self) -> Sequence[Variable]:
        return displacement_gradient(self.d)

    @property
    def degree(self) -> int:
        """That of the linear stress, whose displacement gradients the matrices integrate with the
        same points."""
        degrees = [p.degree for p in (self.E, self.alpha) if isinstance(p, TemperatureProperty)]
        return sum(degrees) + 1 if self.heated else 0

    def __call__(self, z: Sequence[FloatArray], x: FloatArray, t: float) -> Response:
        """Stress y (d d) and its derivatives at points: of F S less the linear stress, with e = E /
        E_0, pressure = beta (T - T_ref), and by T (index _T) and G (module docstring)."""
        d, lam_0, mu_0, first = self.d, self.law.lam, self.law.mu, int(self.heated)
        shape = np.broadcast_shapes(*(v.shape for v in z))
        G = np.stack([np.broadcast_to(v, shape) for v in z[first:]]).reshape(d, d, *shape)
        e: FloatArray | float = 1.0
        # in axes (i, j, points): half = G^T G / 2, strain E, whole = S at E_0 without pressure
        S_T = pressure = np.zeros(())
        if self.heated:
            rise = z[0] - self.reference
            (E, E_T), (alpha, alpha_T) = evaluated(self.E, z[0]), evaluated(self.alpha, z[0])
            e, e_T = E / self.E_0, E_T / self.E_0
            pressure = self.factor * E * alpha * rise
            pressure_T = self.factor * ((E_T * alpha + E * alpha_T) * rise + E * alpha)
        half = np.einsum("ki...,kj...->ij...", G, G) / 2.0
        strain = (G + G.swapaxes(0, 1)) / 2.0 + half
        whole = 2.0 * mu_0 * strain  # S at E_0 without thermal stress
        rest = 2.0 * mu_0 * half  # the same of G^T G / 2
        for A, of in ((whole, strain), (rest, half)):
            A[range(d), range(d)] += lam_0 * np.einsum("ii...->...", of)
        S = e * whole
        S[range(d), range(d)] -= pressure
        # F S less the linear stress, without differences of large numbers
        y = np.einsum("ik...,kj...->ij...", G, S) + rest + (e - 1.0) * whole
        F = G.copy()
        F[range(d), range(d)] += 1.0
        if self.heated:
            y[range(d), range(d)] -= pressure - self.law.beta * rise
            S_T = e_T * whole
            S_T[range(d), range(d)] -= pressure_T
            by_T = np.einsum("ik...,kj...->ij...", F, S_T)
            by_T[range(d), range(d)] += self.law.beta
        # dP_iJ / dG_kL = lam F_iJ F_kL + mu (F_iL F_kJ + F F^T_ik I_JL) + I_ik S_JL
        lam, mu = e * lam_0, e * mu_0
        left = np.einsum("ik...,jk...->ij...", F, F) * mu
        lamF, muF = lam * F, mu * F
        slopes: dict[tuple[int, int], FloatArray | float] = {}
        for r in range(d * d):  # component (i, J) of the stress, and, symmetric, (k, L) of G
            i, J = divmod(r, d)
            for s in range(r, d * d):
                k, L = divmod(s, d)
                slope = lamF[i, J] * F[k, L] + muF[i, L] * F[k, J]
                if i == k:
                    slope += S[J, L]
                if J == L:
                    slope += left[i, k]
                slope -= (lam_0 * (i == J and k == L) + mu_0 * (i == L and k == J)
                          + mu_0 * (r == s))
                slopes[r, first + s] = slopes[s, first + r] = slope
        if self.heated:
            slopes |= {(r, 0): by_T[divmod(r, d)] for r in range(d * d)}
        return Response([y[divmod(r, d)] for r in range(d * d)], slopes)

    @property
    def green_lagrange(self) -> GreenLagrange | None:
        """Of constant E and alpha."""
        if isinstance(self.E, TemperatureProperty) or isinstance(self.alpha, TemperatureProperty):
            return None
        return GreenLagrange(self.law, self.d, self.reference if self.heated else None)

    def arrays(self) -> LawArrays | None:
        """The law for compiled steps: numbers and pairs (stress component, variable) of derivatives
        in the order of `nonlinear_stress`; None where a property has no numbers."""
        E, alpha = numbers_of(self.E), numbers_of(self.alpha)
        if E is None or alpha is None:
            return None
        n, first = self.d**2, int(self.heated)
        # 9 numbers of its own, of which the last is where alpha begins, after those of E
        pairs = [(r, s) for r in range(n) for s in range(n + first)]
        numbers = [self.d, self.heated, self.law.lam, self.law.mu, self.law.beta, self.E_0,
                   self.factor, self.reference, 9.0 + len(E)]
        return LawArrays(np.concatenate([numbers, E, alpha]), (), np.array(pairs, dtype=np.int64),
                         nonlinear_stress, (curve_at,))


def evaluated(of: Property, T: FloatArray) -> tuple[FloatArray | float, FloatArray | float]:
    """Values and derivatives of a property at temperatures T, K."""
    return (of, 0.0) if isinstance(of, int | float) else of.at(T)


def nonlinear_stress(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """The law at N points, which numba compiles: names and formulas of `NonlinearStrains`. numbers:
    d, 1 if it reads T, lam, mu, beta_0, E_0, factor of E alpha in beta, T_ref, first number of
    alpha, E, alpha. z (variables, N): T if it reads it, then grad u; y: stress; slopes: dy/dz."""
    d, first = int(numbers[0]), int(numbers[1])
    lam_0, mu_0, beta_0 = numbers[2], numbers[3], numbers[4]
    half, whole, S, B = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    F, S_T = np.zeros((3, 3)), np.zeros((3, 3))  # B: mu F F^T
    m = d * d
    for n in range(z.shape[1]):
        e, e_T, pressure, pressure_T, rise = 1.0, 0.0, 0.0, 0.0, 0.0
        if first:
            rise = z[0, n] - numbers[7]
            E, E_T = curve_at(numbers, 9, z[0, n])
            alpha, alpha_T = curve_at(numbers, int(numbers[8]), z[0, n])
            e, e_T = E / numbers[5], E_T / numbers[5]
            pressure = numbers[6] * E * alpha * rise
            pressure_T = numbers[6] * ((E_T * alpha + E * alpha_T) * rise + E * alpha)
        spread, trace = 0.0, 0.0  # of `half`, and of the strain
        for i in range(d):
            for j in range(d):
                total = 0.0
                for k in range(d):
                    total += z[first + k * d + i, n] * z[first + k * d + j, n]
                half[i, j] = 0.5 * total
                g = z[first + i * d + j, n]
                F[i, j] = g + 1.0 if i == j else g
                whole[i, j] = 2.0 * mu_0 * (
                    0.5 * (g + z[first + j * d + i, n]) + half[i, j])
            spread += half[i, i]
            trace += z[first + i * d + i, n] + half[i, i]
        for i in range(d):
            whole[i, i] += lam_0 * trace
        for i in range(d):
            for j in range(d):
                S[i, j] = e * whole[i, j]
                S_T[i, j] = e_T * whole[i, j]
            S[i, i] -= pressure
            S_T[i, i] -= pressure_T
        for i in range(d):
            for j in range(d):
                total = 2.0 * mu_0 * half[i, j] + (e - 1.0) * whole[i, j]
                if i == j:
                    total += lam_0 * spread
                    if first:
                        total -= pressure - beta_0 * rise
                for k in range(d):
                    total += z[first + i * d + k, n] * S[k, j]
                y[i * d + j, n] = total
        if not len(slopes):
            continue
        for i in range(d):
            for k in range(d):
                total = 0.0
                for j in range(d):
                    total += F[i, j] * F[k, j]
                B[i, k] = e * mu_0 * total
        for r in range(m):
            i, J = r // d, r % d
            at = r * (m + first)
            if first:
                total = beta_0 if i == J else 0.0
                for k in range(d):
                    total += F[i, k] * S_T[k, J]
                slopes[at, n] = total
                at += 1
            for s in range(m):
                k, L = s // d, s % d
                slope = e * (lam_0 * F[i, J] * F[k, L] + mu_0 * F[i, L] * F[k, J])
                if i == k:
                    slope += S[J, L]
                if J == L:
                    slope += B[i, k]
                if i == J and k == L:
                    slope -= lam_0
                if i == L and k == J:
                    slope -= mu_0
                if r == s:
                    slope -= mu_0
                slopes[at + s, n] = slope
