"""Laws of materials as functions on arrays (`LawFunction`), which numba compiles: the equations of
material_laws.py at N points.

A property is a run of numbers (`TemperatureProperty.numbers`): a table (0, n, its n temperatures,
then the first temperature of each of its n + 1 segments, the value there of each and the slope of
each), or a polynomial (1, n, T_0, least and greatest temperature, n coefficients in powers of T -
T_0). Segment i is that above i of the n temperatures. Arguments of a law:
`core/protocols/term.LawFunction`.
"""

import numpy as np

from sparsemor.core import FloatArray, TemperatureProperty

TABLE, POLYNOMIAL = 0.0, 1.0


def numbers_of(of: TemperatureProperty | float) -> FloatArray | None:
    """Numbers of a property or of a constant; None where a property has none."""
    if isinstance(of, int | float):
        return np.array([POLYNOMIAL, 1.0, 0.0, 0.0, 0.0, of])
    return of.numbers


def curve_at(numbers: FloatArray, first: int, T: float) -> tuple[float, float]:
    """Value and slope at T, K, of the property whose numbers begin at `first`: a table (0, n, its n
    temperatures, then of each of n + 1 segments the first temperature, the value there and the
    slope, n + 1 each), or a polynomial (1, n, T_0, least and greatest temperature, n coefficients
    of powers of T - T_0, the lowest first)."""
    n, at = int(numbers[first + 1]), first + 2
    if numbers[first] == TABLE:
        low, high = 0, n
        while low < high:  # bisection: `low` temperatures of the table are below T
            middle = (low + high) // 2
            if numbers[at + middle] < T:
                low = middle + 1
            else:
                high = middle
        start = at + n + low
        slope = numbers[start + 2 * (n + 1)]
        return numbers[start + n + 1] + slope * (T - numbers[start]), slope
    inside = min(max(T, numbers[at + 1]), numbers[at + 2])  # constant beyond its limits
    if not T == T:  # not a number stays one
        inside = T
    z, value, slope = inside - numbers[at], numbers[at + 2 + n], 0.0
    for i in range(n - 1, 0, -1):  # Horner's scheme
        slope = value + slope * z
        value = numbers[at + 2 + i] + value * z
    return value, slope if inside == T else 0.0


def integral_at(numbers: FloatArray, first: int, T: float) -> float:
    """Integral over temperature up to T, K, of the property whose numbers begin at `first`; those
    of a table are followed by the integrals up to its n temperatures (`with_integrals`), from the
    first of them on; that of a polynomial is from its least temperature on.

    Numbers as in `curve_at`: a table (0, n, n temperatures, n + 1 first temperatures, values and
    slopes of segments), or a polynomial (1, n, T_0, least and greatest temperature, n
    coefficients).
    """
    n, at = int(numbers[first + 1]), first + 2
    if numbers[first] == TABLE:
        low, high = 0, n
        while low < high:  # as in `curve_at`
            middle = (low + high) // 2
            if numbers[at + middle] < T:
                low = middle + 1
            else:
                high = middle
        start = at + n + low
        z = T - numbers[start]
        past: float = numbers[at + n + 3 * (n + 1) + low - 1] if low > 0 else 0.0
        return float(past + z * (
            numbers[start + n + 1] + 0.5 * numbers[start + 2 * (n + 1)] * z))
    inside = min(max(T, numbers[at + 1]), numbers[at + 2])
    if not T == T:
        inside = T
    z, low_z, value = inside - numbers[at], numbers[at + 1] - numbers[at], 0.0
    whole, whole_low = 0.0, 0.0  # integrals over z, and over low_z, divided by these
    for i in range(n - 1, -1, -1):
        a = numbers[at + 3 + i]
        value = a + value * z
        whole = (a / (i + 1) + whole * z)
        whole_low = (a / (i + 1) + whole_low * low_z)
    return float(whole * z - whole_low * low_z + value * (T - inside))


def with_integrals(numbers: FloatArray) -> FloatArray:
    """Numbers of a property, those of a table with the integrals up to its temperatures."""
    if numbers[0] != TABLE:
        return numbers
    n = int(numbers[1])
    nodes, start = numbers[2 : 2 + n], 2 + n
    values, slopes = (numbers[start + k * (n + 1) : start + (k + 1) * (n + 1)] for k in (1, 2))
    z = np.diff(nodes)
    return np.concatenate(
        [numbers, [0.0], np.cumsum(z * (values[1:-1] + 0.5 * slopes[1:-1] * z))])


def conduction(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """Heat flux (k(T) - k_0) grad T, on the left-hand side, at N points; numbers: k_0, then those
    of the property k. z (1 + d, N): T and grad T; y (d, N): flux; slopes (2 d, N): of component i
    by T, then by its gradient, or without rows where none are wanted; gains, x: not used."""
    d = len(z) - 1
    for n in range(z.shape[1]):
        k, slope = curve_at(numbers, 1, z[0, n])
        k -= numbers[0]
        for i in range(d):
            y[i, n] = k * z[i + 1, n]
            if len(slopes):
                slopes[2 * i, n] = slope * z[i + 1, n]
                slopes[2 * i + 1, n] = k


def stored_heat(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """Heat storage rho e' by differences of heat content e (`material_laws.StoredHeat`); numbers:
    rho, c_0, number of earlier values, h, c; gain: 1 in the first step. z: T, T', T''; slopes: by
    T, by T', no rows where none are wanted; x: not used.

    T_0, T_1: temperatures one and two steps of h before. e' = (c - c_0) T' without earlier values,
    (e - e_0) / h with one, (1.5 (e - e_0) - 0.5 (e_0 - e_1)) / h with two, in the first step with
    e_0 - e_1 = (c(T_0) - c_0) (T_0 - T_1)."""
    rho, c_0, earlier, h = numbers[0], numbers[1], int(numbers[2]), numbers[3]
    for n in range(z.shape[1]):
        T, rate = z[0, n], z[1, n]
        c, slope = curve_at(numbers, 4, T)
        if earlier == 0:
            y[0, n] = rho * (c - c_0) * rate
            if len(slopes):
                slopes[0, n] = rho * slope * rate
                slopes[1, n] = rho * (c - c_0)
            continue
        T_0 = T - h * rate + 0.5 * h * h * z[2, n]
        now, past = integral_at(numbers, 4, T) - c_0 * T, integral_at(numbers, 4, T_0) - c_0 * T_0
        change, gain = now - past, 1.0
        if earlier == 2:
            T_1 = 2.0 * T_0 - T + h * h * z[2, n]
            gone = past - (integral_at(numbers, 4, T_1) - c_0 * T_1)
            if gains[0] > 0.5:
                gone = (curve_at(numbers, 4, T_0)[0] - c_0) * (T_0 - T_1)
            change = 1.5 * change - 0.5 * gone
            gain = 1.5
        y[0, n] = rho * change / h
        if len(slopes):
            slopes[0, n] = rho * (c - c_0) * gain / h
            slopes[1, n] = 0.0


def softening(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """Stress (E(T)/E_0 - 1) C_0 : eps, Pa, at N points; numbers: d, E_0, lambda, mu, E. z (1 + d d,
    N): T, then grad u row by row; y (d d, N): stress; slopes: in the order of `softening_pairs`, of
    each component by T, then by the gradients that it depends on; gains, x: not used."""
    d, E_0, lam, mu = int(numbers[0]), numbers[1], numbers[2], numbers[3]
    for n in range(z.shape[1]):
        value, slope = curve_at(numbers, 4, z[0, n])
        e, spread, at = (value - E_0) / E_0, 0.0, 0
        for i in range(d):
            spread += z[1 + i * d + i, n]
        spread *= lam
        for i in range(d):
            for j in range(d):
                r = i * d + j
                stress = mu * (z[1 + r, n] + z[1 + j * d + i, n])
                if i == j:
                    stress += spread
                y[r, n] = e * stress
                if not len(slopes):
                    continue
                slopes[at, n] = slope / E_0 * stress
                at += 1
                if i == j:
                    for k in range(d):
                        slopes[at, n] = e * (lam + 2.0 * mu if k == i else lam)
                        at += 1
                else:
                    slopes[at, n] = slopes[at + 1, n] = e * mu
                    at += 2


def softening_pairs(d: int) -> list[tuple[int, int]]:
    """Pairs (stress component, variable) of the derivatives, in the order of `softening`: by T,
    then for a normal stress by du_k/dx_k, for a shear stress by both gradients of its shear."""
    found = []
    for i in range(d):
        for j in range(d):
            r = i * d + j
            found.append((r, 0))
            found += ([(r, 1 + k * d + k) for k in range(d)] if i == j
                      else [(r, 1 + r), (r, 1 + j * d + i)])
    return found


def expansion(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """Thermal stress -(beta(T) - beta_0) (T - T_ref), Pa, at N points; numbers: factor of E alpha
    in beta, beta_0, T_ref, first number of alpha, E (from number 4 on), alpha. z (1, N): T; y (d,
    N): the equal normal stresses; slopes (d, N): by T, no rows where none are wanted."""
    factor, beta_0, reference, first = numbers[0], numbers[1], numbers[2], int(numbers[3])
    for n in range(z.shape[1]):
        rise = z[0, n] - reference
        E, E_T = curve_at(numbers, 4, z[0, n])
        alpha, alpha_T = curve_at(numbers, first, z[0, n])
        change = factor * E * alpha - beta_0
        for i in range(len(y)):
            y[i, n] = -change * rise
            if len(slopes):
                slopes[i, n] = -factor * (E_T * alpha + E * alpha_T) * rise - change
