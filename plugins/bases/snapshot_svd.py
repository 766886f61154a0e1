"""Leading left singular vectors of snapshot matrices: in memory down to round-off, and out of core
by randomized subspace iteration (Halko, Martinsson and Tropp 2011, doi 10.1137/090771806)."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.core.linalg.dense import svd
from sparsemor.core.linalg.snapshots import column_chunks

FIRST, EXTRA, PASSES = 64, 16, 12
"""Columns of the first random sketch if no `count` is given; oversampling columns; largest number
of passes over the snapshots for one sketch size."""
STAGNATION = 1e-4
"""Subspace iteration ends when a pass gains at most this share of the squared norm that is not
captured yet."""
CHUNK = 1 << 22
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


def left_singular(
    A: FloatArray, level: float, rest: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Left singular vectors U (n, r) and singular values (r,), decreasing, of A (n, M) in memory.

    All singular values above `level` times the largest are included, each accurate to a small
    multiple of round-off of the largest. The method of snapshots (eigenvectors of A^T A) would lose
    everything below 1e-8. rest: norm of a part of A, relative to the largest singular value, that
    may be left out.
    """
    n, M = A.shape
    # more columns than `largest` cost as much as the whole decomposition
    size, largest = FIRST, min(n, M) // (2 if rest else 3)
    allowed = max(rest, 0.5 * min(level, round_off_level(n, M)))
    Q: FloatArray = np.zeros((n, 0))
    rng = np.random.default_rng([n, M])  # fixed: the same snapshots give the same atoms
    while size <= largest:
        # the error is measured afterwards, so the accuracy does not rest on probability
        Q = _extended(Q, A @ rng.standard_normal((M, size - Q.shape[1])))
        B = Q.T @ A
        U, s = _dense(B)
        if _residual_norm(A, Q, B) <= allowed * s[0]:
            return Q @ U, s
        size *= 2
    return _dense(A)


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


def _extended(Q: FloatArray, Y: FloatArray) -> FloatArray:
    """Orthonormal basis of the columns of Q (n, l), which are orthonormal, and Y (n, j)."""
    for _ in range(2):  # once leaves what cancellation brings back
        Y = np.linalg.qr(Y - Q @ (Q.T @ Y))[0]
    return np.hstack([Q, Y])


def _residual_norm(A: FloatArray, Q: FloatArray, B: FloatArray) -> float:
    """Frobenius norm of A - Q B, computed from its entries: a difference of norms is lost below
    1e-8."""
    step = max(1, CHUNK // A.shape[0])
    return float(np.linalg.norm([
        np.linalg.norm(A[:, j : j + step] - Q @ B[:, j : j + step])
        for j in range(0, A.shape[1], step)]))


@dataclass(frozen=True, slots=True, eq=False)
class ScaledSnapshots:
    """Scaled snapshot matrix (A - offset) / divisors, A (n, M), evaluated by column chunks.

    offset (n,); divisors (M,), one per column; total: sum of the squared norms of its columns.
    """

    A: FloatArray
    offset: FloatArray
    divisors: FloatArray
    total: float

    @classmethod
    def from_snapshots(cls, A: FloatArray, offset: FloatArray, weighted: bool) -> "ScaledSnapshots":
        """Snapshots A (n, M) less `offset` (n,); weighted: each column is divided by the square
        root of its norm, columns of zeros excepted."""
        with np.errstate(over="ignore", under="ignore"):  # the caller checks `total`
            norms = np.concatenate([
                np.linalg.norm(part - offset[:, None], axis=0) for _, part in column_chunks(A)])
            divisors = np.ones(len(norms))
            if weighted:
                divisors = np.sqrt(np.where(norms > 0.0, norms, 1.0))
            return cls(A, offset, divisors, float(np.sum((norms / divisors) ** 2)))

    def in_memory(self) -> FloatArray:
        """The scaled matrix (n, M)."""
        return self._scaled(slice(None), self.A)

    def share(self, Q: FloatArray) -> float:
        """Share of the summed squared norms of the columns in the span of orthonormal columns Q (n,
        k)."""
        return 1.0 - self.residual_norm(Q, self.coefficients(Q).T) ** 2 / self.total

    def images(self, X: FloatArray) -> FloatArray:
        """Product (n, l) of the scaled snapshot matrix with X (M, l), in one pass."""
        Y: FloatArray = np.zeros((len(self.offset), X.shape[1]))
        for at, part in column_chunks(self.A):
            Y += self._scaled(at, part) @ X[at]
        return Y

    def coefficients(self, Q: FloatArray) -> FloatArray:
        """Product (M, l) of the transposed scaled snapshot matrix with Q (n, l), in one pass."""
        return np.concatenate([
            self._scaled(at, part).T @ Q for at, part in column_chunks(self.A)])

    def residual_norm(self, Q: FloatArray, B: FloatArray) -> float:
        """Frobenius norm of the scaled snapshot matrix less Q B, computed from the entries in one
        pass."""
        return float(np.linalg.norm([
            _residual_norm(self._scaled(at, part), Q, B[:, at])
            for at, part in column_chunks(self.A)]))

    def _scaled(self, at: slice, part: FloatArray) -> FloatArray:
        return np.asarray((part - self.offset[:, None]) / self.divisors[at], dtype=np.float64)


def column_mean(A: FloatArray) -> FloatArray:
    """Mean (n,) of the columns of A (n, M)."""
    sums = [part.sum(axis=1) for _, part in column_chunks(A)]
    return np.asarray(np.sum(sums, axis=0) / A.shape[1])


@dataclass(frozen=True, slots=True, eq=False)
class LeadingVectors:
    """Leading left singular vectors U (n, l) and singular values (l,), decreasing.

    complete: True if the remainder is round-off; passes: number of passes over the snapshots.
    """

    U: FloatArray
    values: FloatArray
    complete: bool
    passes: int


def leading_vectors(
    snapshots: ScaledSnapshots, count: int | None, energy: float | None
) -> LeadingVectors | None:
    """Leading left singular vectors by randomized subspace iteration, orthonormal after each half
    step.

    `count` columns, or as many as reach the share `energy` of the squared norm, whichever is fewer;
    if neither is set, or round-off is reached first, all above round-off. None if more than about a
    third of min(n, M) columns would be needed.

    Halko, Martinsson and Tropp, algorithm 4.4. Passes end when the kept columns gain at most 1e-4
    of the squared norm that they miss. The random sketch depends on the shape of the matrix only,
    so the seed of a scene does not change the basis.
    """
    n, M = snapshots.A.shape
    rng = np.random.default_rng([n, M])
    most = max(min(n, M) // 3, min(n, M, FIRST))
    wanted = FIRST if count is None else count + max(EXTRA, count // 4)
    size, passes = min(wanted, n, M), 0
    Q: FloatArray = np.zeros((n, 0))
    while True:
        # images(X) = A X
        Q = _extended(Q, snapshots.images(rng.standard_normal((M, size - Q.shape[1]))))
        found = _iterated(snapshots, Q, count, energy, passes + 1)
        passes = found.passes
        if found.complete or (count is not None and (energy is None or size >= wanted)):
            return found
        # the last EXTRA vectors are oversampling: less accurate than the others
        inner = found.values[: max(len(found.values) - EXTRA, 1)]
        if energy is not None and _reaches(float(inner @ inner), snapshots.total, energy):
            return found
        if size >= most:
            return None
        size, Q = min(2 * size, most), found.U


def _iterated(
    snapshots: ScaledSnapshots, Q: FloatArray, count: int | None, energy: float | None, passes: int
) -> LeadingVectors:
    """Subspace iteration from Q (n, l) until the captured squared norm stagnates; passes: number of
    passes over the snapshots before it."""
    before, limit, total = -np.inf, passes + PASSES, snapshots.total
    while True:
        W, s, Vt = svd(snapshots.coefficients(Q))  # of A^T Q, so Q^T A = V diag(s) W^T
        U, passes = Q @ Vt.T, passes + 1
        captured = float(np.sum(s[:_kept(s, total, count, energy)] ** 2))
        rest = max(total - captured, 0.0)
        if rest <= 1e-12 * total:  # a difference of squares tells no more than this
            passes += 1
            noise = round_off_level(*snapshots.A.shape) * s[0]
            if snapshots.residual_norm(U, s[:, None] * W.T) <= 0.5 * noise:
                return LeadingVectors(U, s, True, passes)
        every = count is None and energy is None  # widening finds more than going on
        if every or captured - before <= STAGNATION * rest or passes >= limit:
            return LeadingVectors(U, s, False, passes)
        before, passes = captured, passes + 1
        Q = np.linalg.qr(snapshots.images(W))[0]  # of A W


def _kept(s: FloatArray, total: float, count: int | None, energy: float | None) -> int:
    """Number of columns that `count` and `energy` ask for among those with singular values s."""
    kept = len(s) if count is None else min(count, len(s))
    if energy is not None:
        enough = np.flatnonzero(_reaches(np.cumsum(s * s), total, energy))
        kept = min(kept, int(enough[0]) + 1) if enough.size else kept
    return kept


def _reaches(captured: FloatArray | float, total: float, energy: float) -> FloatArray:
    """True where a captured squared norm is at least the share `energy` of the total."""
    return np.asarray(total - captured <= (1.0 - energy) * total)
