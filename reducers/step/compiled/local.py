"""Terms that depend on the unknowns of a block, as functions on arrays: residual L y(z) of laws at
points, z = P x + o(t), and its Jacobian L (dy/dz) P (`PointArrays`)."""

from typing import NamedTuple

import numpy as np

from sparsemor.core import FloatArray, IntArray


class LocalArrays(NamedTuple):
    """Constants of the local terms of one block, stacked.

    terms (n, 12): of each its law, elements, points per element, then first and last number of its
    `numbers`, first amplitude, first of `points`, and first and last of its reads, tests and
    pairs, without the last of the latter. numbers, gains: constants and amplitudes of the laws;
    gains, effects_at: numbers of the first tabulated amplitude and prescribed value. weights (q,),
    coordinates (d, q): of all points. P (p, k), offset (p,), effects (p, f): as in `PointArrays`
    for all k inputs, rated, bent (2,): first and last row whose rates, and second differences, a
    law reads; moved (2,), moving (m, s): the same for values that the s active unknowns change, and
    these rows and columns of P. reads (r, 3): first row of P, 1 where there is one per point, 1 for
    a rate and 2 for a second difference; tests (m, 2): first column of L, 1 where it has one per
    point; pairs (j, 2): test and read of each derivative. L (l, w), the test functions.
    """

    terms: IntArray
    numbers: FloatArray
    gains: int
    effects_at: int
    weights: FloatArray
    coordinates: FloatArray
    P: FloatArray
    offset: FloatArray
    effects: FloatArray
    rated: IntArray
    bent: IntArray
    moved: IntArray
    moving: FloatArray
    reads: IntArray
    tests: IntArray
    pairs: IntArray
    L: FloatArray


_NUMBERS, _MATRIX = np.zeros(0), np.zeros((0, 0))
_PAIRS = np.zeros((0, 2), dtype=np.int64)
NO_LOCAL = LocalArrays(
    np.zeros((0, 12), dtype=np.int64), _NUMBERS, -1, -1, _NUMBERS, _MATRIX, _MATRIX, _NUMBERS,
    _MATRIX, np.zeros(2, dtype=np.int64), np.zeros(2, dtype=np.int64),
    np.zeros(2, dtype=np.int64), _MATRIX, np.zeros((0, 3), dtype=np.int64), _PAIRS, _PAIRS, _MATRIX)
"""No local terms, of the type of all."""


def no_law(
    numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """Law that does nothing, for numbers that no law of a model has."""


law_0 = law_1 = law_2 = law_3 = law_4 = law_5 = law_6 = law_7 = no_law
LAWS = 8
"""Largest number of laws with different functions, with which the steps are compiled."""


def evaluate_law(
    law: int, numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """The law of this number."""
    if law == 0:
        law_0(numbers, gains, z, x, y, slopes)
    elif law == 1:
        law_1(numbers, gains, z, x, y, slopes)
    elif law == 2:
        law_2(numbers, gains, z, x, y, slopes)
    elif law == 3:
        law_3(numbers, gains, z, x, y, slopes)
    elif law == 4:
        law_4(numbers, gains, z, x, y, slopes)
    elif law == 5:
        law_5(numbers, gains, z, x, y, slopes)
    elif law == 6:
        law_6(numbers, gains, z, x, y, slopes)
    else:
        law_7(numbers, gains, z, x, y, slopes)


def variables(
    a: LocalArrays, timed: FloatArray, x: FloatArray, v: FloatArray, z: FloatArray, w: FloatArray
) -> None:
    """Variables z (p,) and their rates w (p,), zero where no law reads them, for the inputs x with
    rates v."""
    z[:] = a.offset + np.dot(a.P, x)
    w[:] = 0.0
    rated = slice(a.rated[0], a.rated[1])
    if a.rated[1] > a.rated[0]:
        w[rated] = np.dot(a.P[rated], v)
    count = a.effects.shape[1]
    for j in range(count):
        z += timed[a.effects_at + j] * a.effects[:, j]
        w[rated] += timed[a.effects_at + count + j] * a.effects[rated, j]


def bends(a: LocalArrays, timed: FloatArray, b: FloatArray, u: FloatArray) -> None:
    """Second differences u (p,) of the variables, zero where no law reads them, for those b of the
    inputs."""
    u[:] = 0.0
    bent = slice(a.bent[0], a.bent[1])
    if a.bent[1] > a.bent[0]:
        u[bent] = np.dot(a.P[bent], b)
        count = a.effects.shape[1]
        for j in range(count):
            u[bent] += timed[a.effects_at + 2 * count + j] * a.effects[bent, j]


def evaluate_points(
    a: LocalArrays, timed: FloatArray, z: FloatArray, w: FloatArray, u: FloatArray, c1: float,
    flux: FloatArray, slope: FloatArray
) -> None:
    """Fills flux (w,), so that L flux is the residual, and slope (w, s), so that L slope is its
    Jacobian by the active unknowns, unless slope has no rows."""
    flux[:] = 0.0
    slope[:] = 0.0
    for term in range(len(a.terms)):
        about = a.terms[term]
        E, Q, first, last, gain = about[1], about[2], about[3], about[4], about[5]
        point, read, reads, test, tests, pair = (
            about[6], about[7], about[8], about[9], about[10], about[11])
        end = a.terms[term + 1, 11] if term + 1 < len(a.terms) else len(a.pairs)
        n, derivatives = E * Q, end - pair if len(slope) else 0
        values = np.empty((reads - read, n))
        for i in range(reads - read):
            start, wide = a.reads[read + i, 0], a.reads[read + i, 1]
            kind = a.reads[read + i, 2]
            source = z if kind == 0 else w if kind == 1 else u
            for q in range(n):
                values[i, q] = source[start + q if wide else start + q // Q]
        y, slopes = np.zeros((tests - test, n)), np.zeros((derivatives, n))
        evaluate_law(about[0], a.numbers[first:last], timed[a.gains + gain :], values,
                     a.coordinates[:, point : point + n].copy(), y, slopes)
        for i in range(tests - test):
            start, wide = a.tests[test + i, 0], a.tests[test + i, 1]
            for q in range(n):
                if wide:
                    flux[start + q] = y[i, q]
                else:
                    flux[start + q // Q] += a.weights[point + q] * y[i, q]
        for k in range(derivatives):
            i, j = test + a.pairs[pair + k, 0], read + a.pairs[pair + k, 1]
            start, wide = a.tests[i, 0], a.tests[i, 1]
            row, own, rate = a.reads[j, 0], a.reads[j, 1], a.reads[j, 2]
            once = not (wide or own)  # one row for all points of an element
            for e in range(E):
                factor = 0.0
                for q in range(e * Q, (e + 1) * Q):
                    share = slopes[k, q] * (c1 if rate == 1 else 1.0)
                    if not wide:
                        share *= a.weights[point + q]
                    factor = factor + share if once else share
                    if once and q + 1 < (e + 1) * Q:
                        continue
                    to, of = start + q if wide else start + e, row + q if own else row + e
                    of -= a.moved[0]
                    if 0 <= of < len(a.moving):
                        for c in range(slope.shape[1]):
                            slope[to, c] += factor * a.moving[of, c]


def rows_at(
    a: LocalArrays, timed: FloatArray, z: FloatArray, w: FloatArray, u: FloatArray
) -> FloatArray:
    """Residual (l,) at variables z with rates w and second differences u."""
    flux = np.empty(a.L.shape[1])
    evaluate_points(a, timed, z, w, u, 0.0, flux, np.zeros((0, 0)))
    found: FloatArray = np.dot(a.L, flux)
    return found


def rows_of(a: LocalArrays, timed: FloatArray, x: FloatArray, v: FloatArray) -> FloatArray:
    """Residual (l,) at the inputs x with rates v."""
    z, w = np.empty(len(a.offset)), np.empty(len(a.offset))
    variables(a, timed, x, v, z, w)
    return rows_at(a, timed, z, w, w)


def local_rows(
    a: LocalArrays, timed: FloatArray, z: FloatArray, w: FloatArray, u: FloatArray, c1: float,
    c2: float, d: FloatArray
) -> FloatArray:
    """Residual (l,) at the increments d (s,) from variables z with rates w and second differences
    u, which grow by c1 and c2 times those of z."""
    if not np.any(d):
        return rows_at(a, timed, z, w, u)
    change, moved = np.dot(a.moving, d), slice(a.moved[0], a.moved[1])
    values, rates, second = z.copy(), w.copy(), u.copy()
    values[moved] += change
    rates[moved] += c1 * change
    second[moved] += c2 * change
    return rows_at(a, timed, values, rates, second)


def factor_in_place(A: FloatArray, pivots: IntArray) -> bool:
    """LU factors of A with partial pivoting, in place; False where A is singular."""
    n = len(A)
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[p, k]):
                p = i
        pivots[k] = p
        if not 0.0 < abs(A[p, k]) < np.inf:
            return False
        if p != k:
            for j in range(n):
                A[k, j], A[p, j] = A[p, j], A[k, j]
        for i in range(k + 1, n):
            f = A[i, k] / A[k, k]
            A[i, k] = f
            for j in range(k + 1, n):
                A[i, j] -= f * A[k, j]
    return True


def solve_factored(A: FloatArray, pivots: IntArray, r: FloatArray) -> None:
    """Solves A x = r with the factors of A: r becomes x."""
    n = len(r)
    for k in range(n):
        p = pivots[k]
        r[k], r[p] = r[p], r[k]
    for k in range(n):
        for j in range(k):
            r[k] -= A[k, j] * r[j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            r[k] -= A[k, j] * r[j]
        r[k] /= A[k, k]
