"""Products of dense matrices as functions that numba compiles."""

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
