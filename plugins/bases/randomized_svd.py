"""Left singular vectors of a snapshot matrix down to round-off, by a randomized range finder."""

import numpy as np

from sparsemor.core import FloatArray, svd
from sparsemor.plugins.bases.inner_product import InnerProduct

_FIRST_SKETCH = 64
_CHUNK = 1 << 22
"""Number of entries of the residual that are held in memory at once: 32 MB."""


def round_off_level(n: int, M: int) -> float:
    """Relative singular value below which columns of an (n, M) snapshot matrix are noise.

    One rounding of each entry adds a random matrix whose norm is at most (sqrt n + sqrt M) eps
    times the largest singular value. The noise of snapshots from sparse direct solves was measured
    as 2e-15 (elastic) and 4e-16 (thermal) for n = 1300 and 660, M = 2000, where this level is
    7e-14; columns near 1e-13 still carry field errors near 1e-10 and must be kept. The usual max(n,
    M) eps would drop some of them.
    """
    return float(4.0 * (np.sqrt(n) + np.sqrt(M)) * np.finfo(np.float64).eps)


def weighted(A: FloatArray, norms: FloatArray) -> FloatArray:
    """Columns of A (n, M) divided by the square roots of their norms (M,); zero columns stay
    zero."""
    return np.asarray(A / np.sqrt(np.where(norms > 0.0, norms, 1.0)))


def held(A: FloatArray, Q: FloatArray, product: InnerProduct) -> float:
    """Share of the summed squared norms of the columns of A (n, M) in the span of columns Q (n, k),
    orthonormal in the product."""
    missed = _residual(A, Q, product.times(Q).T @ A, product) / product.norm(A)
    return 1.0 - missed * missed


def left_singular(
    A: FloatArray, level: float, rest: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Left singular vectors U (n, r) and singular values (r,), decreasing, of A (n, M).

    All singular values above `level` times the largest are included, each accurate to a small
    multiple of round-off of the largest. The method of snapshots (eigenvectors of A^T A) would lose
    everything below 1e-8. rest: norm of a part of A, relative to the largest singular value, that
    may be left out.
    """
    n, M = A.shape
    size, largest = _FIRST_SKETCH, min(n, M) // (2 if rest else 3)
    allowed = max(rest, 0.5 * min(level, round_off_level(n, M)))
    Q: FloatArray = np.zeros((n, 0))
    rng = np.random.default_rng([n, M])  # fixed: the same snapshots give the same atoms
    while size <= largest:
        Q = _extend(A, Q, size, rng)
        B = Q.T @ A
        U, s = _dense(B)
        if _residual(A, Q, B, InnerProduct()) <= allowed * s[0]:
            return Q @ U, s
        size *= 2
    return _dense(A)


def _extend(A: FloatArray, Q: FloatArray, size: int, rng: np.random.Generator) -> FloatArray:
    """Orthonormal columns (n, size): Q (n, l) and a Gaussian sketch of the rest of A (n, M).

    Halko, Martinsson and Tropp 2011, doi 10.1137/090771806. The error is measured afterwards, so
    the accuracy does not rest on probability.
    """
    Y = A @ rng.standard_normal((A.shape[1], size - Q.shape[1]))
    for _ in range(2):  # once leaves what cancellation brings back
        Y -= Q @ (Q.T @ Y)
        Y = np.linalg.qr(Y)[0]
    return np.hstack([Q, Y])


def _residual(A: FloatArray, Q: FloatArray, B: FloatArray, product: InnerProduct) -> float:
    """Norm of A - Q B (root of the summed squares of its columns), computed from its entries: a
    difference of norms is lost below 1e-8."""
    step = max(1, _CHUNK // A.shape[0])
    parts = [
        product.norm(A[:, j : j + step] - Q @ B[:, j : j + step])
        for j in range(0, A.shape[1], step)
    ]
    return float(np.linalg.norm(parts))


def _dense(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Left singular vectors and singular values of A by a backward stable method: Householder QR of
    the long side, then the SVD of the small triangular factor."""
    n, M = A.shape
    if M > n:
        A = np.asarray(np.linalg.qr(A.T, mode="r")).T
    Q = None
    if n > 2 * M:
        Q, A = np.linalg.qr(A)
    U, s, _ = svd(A)
    return (U if Q is None else Q @ U), s
