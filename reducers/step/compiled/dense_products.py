"""Products of dense matrices as functions that numba compiles."""

from sparsemor.core import FloatArray

TOGETHER = 8
"""Number of vectors that are multiplied together."""


def add_product(A: FloatArray, x: FloatArray, y: FloatArray) -> None:
    """Adds x A to y (s,), for A (k, s), or its first s columns, and the first k numbers of x."""
    k = len(A)
    for i in range(0, k - 3, 4):
        A0, A1, A2, A3 = A[i], A[i + 1], A[i + 2], A[i + 3]
        x0, x1, x2, x3 = x[i], x[i + 1], x[i + 2], x[i + 3]
        for j in range(len(y)):
            y[j] += A0[j] * x0 + A1[j] * x1 + A2[j] * x2 + A3[j] * x3
    for i in range(k - k % 4, k):
        A0, x0 = A[i], x[i]
        for j in range(len(y)):
            y[j] += A0[j] * x0


def add_operator(A: FloatArray, x: FloatArray, y: FloatArray) -> None:
    """Adds x A to the first k numbers of y, for a square matrix A (k, k), or a diagonal (1, k)."""
    k = A.shape[1]
    if len(A) == k:
        add_product(A, x, y[:k])
    else:
        for j in range(k):
            y[j] += A[0, j] * x[j]


def add_products(A: FloatArray, x: FloatArray, first: int, y: FloatArray, start: int) -> None:
    """Adds x A to y for A (k, s), columns from `first` on of x (T, n) and from `start` on of y (T,
    n). A matrix that does not fit into the cache is read once for several steps; the sums of a step
    are the same whichever the others are."""
    last = start + A.shape[1]
    for begin in range(0, len(x), TOGETHER):
        for c in range(0, len(A), 4):
            for t in range(begin, min(begin + TOGETHER, len(x))):
                add_product(A[c : c + 4], x[t, first + c :], y[t, start:last])
