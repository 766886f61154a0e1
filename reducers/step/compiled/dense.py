"""Products of dense matrices, and a dense solve, as functions that numba compiles."""

from math import inf, sqrt

import numpy as np

from sparsemor.core import FloatArray

TOGETHER = 8
"""Number of vectors that are multiplied together."""


def product(A: FloatArray, x: FloatArray) -> FloatArray:
    """A x for a matrix A (s, k), or (1, k) for a diagonal."""
    y: FloatArray = A[0] * x if len(A) == 1 and len(x) > 1 else np.dot(A, x)
    return y


def add_product(A: FloatArray, x: FloatArray, y: FloatArray, rows: int, columns: int) -> None:
    """Adds to y the first `columns` of x A, for A with this many rows, filled up with zeros to a
    multiple of 4; x has as many numbers."""
    for i in range(0, rows, 4):
        A0, A1, A2, A3 = A[i], A[i + 1], A[i + 2], A[i + 3]
        x0, x1, x2, x3 = x[i], x[i + 1], x[i + 2], x[i + 3]
        for j in range(columns):
            y[j] += A0[j] * x0 + A1[j] * x1 + A2[j] * x2 + A3[j] * x3


def add_rates(
    A: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray, y: FloatArray, rows: int,
    without: int, columns: int
) -> None:
    """Adds x A, v A and a A to the rows of y (3, n), as `add_product`; a A without its first
    columns. A is read once."""
    for i in range(0, rows, 4):
        A0, A1, A2, A3 = A[i], A[i + 1], A[i + 2], A[i + 3]
        x0, x1, x2, x3 = x[i], x[i + 1], x[i + 2], x[i + 3]
        v0, v1, v2, v3 = v[i], v[i + 1], v[i + 2], v[i + 3]
        a0, a1, a2, a3 = a[i], a[i + 1], a[i + 2], a[i + 3]
        X, V = y[0], y[1]
        for j in range(without):
            X[j] += A0[j] * x0 + A1[j] * x1 + A2[j] * x2 + A3[j] * x3
            V[j] += A0[j] * v0 + A1[j] * v1 + A2[j] * v2 + A3[j] * v3
        A0, A1, A2, A3 = A0[without:], A1[without:], A2[without:], A3[without:]
        X, V, Y = X[without:], V[without:], y[2][without:]
        for j in range(columns):
            X[j] += A0[j] * x0 + A1[j] * x1 + A2[j] * x2 + A3[j] * x3
            V[j] += A0[j] * v0 + A1[j] * v1 + A2[j] * v2 + A3[j] * v3
            Y[j] += A0[j] * a0 + A1[j] * a1 + A2[j] * a2 + A3[j] * a3


def add_products(A: FloatArray, x: FloatArray, first: int, y: FloatArray, start: int) -> None:
    """Adds x A to y for A (k, s), columns from `first` on of x (T, n) and from `start` on of y (T,
    n). A matrix that does not fit into the cache is read once for several steps; the sums of a step
    are the same whichever the others are."""
    k, s = A.shape
    for begin in range(0, len(x), TOGETHER):
        end = min(begin + TOGETHER, len(x))
        for c in range(0, k - 3, 4):
            A0, A1, A2, A3, at = A[c], A[c + 1], A[c + 2], A[c + 3], first + c
            for t in range(begin, end):
                x0, x1, x2, x3 = x[t, at], x[t, at + 1], x[t, at + 2], x[t, at + 3]
                row = y[t][start : start + s]
                for j in range(s):
                    row[j] += x0 * A0[j] + x1 * A1[j] + x2 * A2[j] + x3 * A3[j]
        for c in range(k - k % 4, k):
            for t in range(begin, end):
                row = y[t][start : start + s]
                for j in range(s):
                    row[j] += x[t, first + c] * A[c, j]


def solve_in_place(A: FloatArray, r: FloatArray) -> None:
    """Solves A x = r by elimination with partial pivoting: r becomes x, nan where A is singular."""
    n = len(r)
    for k in range(n):
        p, most = k, abs(A[k, k])
        for i in range(k + 1, n):
            if abs(A[i, k]) > most:
                p, most = i, abs(A[i, k])
        if not 0.0 < most < inf:
            r[:] = np.nan
            return
        if p != k:
            for j in range(k, n):
                A[k, j], A[p, j] = A[p, j], A[k, j]
            r[k], r[p] = r[p], r[k]
        for i in range(k + 1, n):
            f = A[i, k] / A[k, k]
            if f != 0.0:
                for j in range(k + 1, n):
                    A[i, j] -= f * A[k, j]
                r[i] -= f * r[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            r[k] -= A[k, j] * r[j]
        r[k] /= A[k, k]


def norm(x: FloatArray, n: int) -> float:
    """Euclidean norm of the first n numbers."""
    total = 0.0
    for i in range(n):
        total += x[i] * x[i]
    return sqrt(total)
