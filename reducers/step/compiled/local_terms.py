"""Terms that depend on the unknowns, as functions on arrays: residual L y(z) of laws at points,
z = P x + o(t) (`PointArrays`). Their Jacobians are those of the uncompiled solver."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sparsemor.core import FloatArray, IntArray


class LocalArrays(NamedTuple):
    """Constants of terms with the same rows and inputs, stacked.

    terms (n, 10): of each its law, elements, points per element, then first and last number of its
    `numbers`, first amplitude, first of `points`, first and last of its reads, and of its tests
    the first. numbers, gains: constants and amplitudes of the laws; gains, effects_at: numbers of
    the first tabulated amplitude and prescribed value. weights (q,), coordinates (d, q): of all
    points. P (p, k), offset (p,), effects (p, f): as in `PointArrays` for all k inputs; rated (2,
    2): first and last row whose rates, and second differences, a law reads. reads (r, 3): first row
    of P, 1 where there is one per point, 1 for a rate and 2 for a second difference; tests (m, 2):
    first column of L, 1 where it has one per point. L (l, w), the test functions.
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
    reads: IntArray
    tests: IntArray
    L: FloatArray


_NUMBERS, _MATRIX = np.zeros(0), np.zeros((0, 0))
NO_LOCAL = LocalArrays(
    np.zeros((0, 10), dtype=np.int64), _NUMBERS, -1, -1, _NUMBERS, _MATRIX, _MATRIX, _NUMBERS,
    _MATRIX, np.zeros((2, 2), dtype=np.int64), np.zeros((0, 3), dtype=np.int64),
    np.zeros((0, 2), dtype=np.int64), _MATRIX)
"""No terms, of the type of all."""


def no_law(
    law: int, numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """Instead of a law with a number that no law of a model has."""


first_law: Callable[..., None] = no_law
other_laws: Callable[..., None] = no_law


def evaluate_law(
    law: int, numbers: FloatArray, gains: FloatArray, z: FloatArray, x: FloatArray, y: FloatArray,
    slopes: FloatArray
) -> None:
    """The law of this number. The steps are compiled with a copy for each law of a model: it is
    `first_law`, and `other_laws` the copy for the next one."""
    if law == 0:
        first_law(numbers, gains, z, x, y, slopes)
    else:
        other_laws(law - 1, numbers, gains, z, x, y, slopes)


def rows_of(
    a: LocalArrays, timed: FloatArray, x: FloatArray, v: FloatArray, b: FloatArray
) -> FloatArray:
    """Residual (l,) at the inputs x with rates v and second differences b."""
    z, rates = a.offset + np.dot(a.P, x), np.zeros((2, len(a.offset)))
    effects = a.effects.shape[1]
    for j in range(effects):
        z += timed[a.effects_at + j] * a.effects[:, j]
    for of in range(2):
        first, last = a.rated[of, 0], a.rated[of, 1]
        if last > first:
            rates[of, first:last] = np.dot(a.P[first:last], v if of == 0 else b)
            for j in range(effects):
                rates[of, first:last] += timed[
                    a.effects_at + (of + 1) * effects + j] * a.effects[first:last, j]
    flux = np.zeros(a.L.shape[1])  # y times the weights of the points, for the columns of L
    for term in range(len(a.terms)):
        row = a.terms[term]  # columns: `LocalArrays.terms`
        law, elements, Q, point = row[0], row[1], row[2], row[6]
        numbers, first_gain, read, test = a.numbers[row[3] : row[4]], row[5], row[7], row[9]
        n, reads = elements * Q, row[8] - read
        tests = (a.terms[term + 1, 9] if term + 1 < len(a.terms) else len(a.tests)) - test
        values, y = np.empty((reads, n)), np.zeros((tests, n))
        for i in range(reads):
            start, by_point, kind = a.reads[read + i]
            source = z if kind == 0 else rates[kind - 1]
            for q in range(n):
                values[i, q] = source[start + q if by_point else start + q // Q]
        evaluate_law(law, numbers, timed[a.gains + first_gain :], values,
                     a.coordinates[:, point : point + n].copy(), y, np.zeros((0, n)))
        for i in range(tests):
            start, by_point = a.tests[test + i]
            for q in range(n):
                if by_point:  # L includes the weights
                    flux[start + q] = y[i, q]
                else:
                    flux[start + q // Q] += a.weights[point + q] * y[i, q]
    found: FloatArray = np.dot(a.L, flux)
    return found
