"""Leading left singular vectors of snapshot matrices that are too large to hold in memory."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core import FloatArray, column_chunks, needs_chunks, svd
from sparsemor.plugins.bases.inner_product import InnerProduct
from sparsemor.plugins.bases.randomized_svd import round_off_level

FIRST, EXTRA, PASSES = 64, 16, 12
"""Columns of the first random sketch if no `count` is given; oversampling columns; largest number
of passes over the snapshots for one sketch size."""
SETTLED = 1e-4
"""Subspace iteration ends when a pass gains at most this share of the squared norm that is not
captured yet."""


@dataclass(frozen=True, slots=True, eq=False)
class Snapshots:
    """Scaled snapshot matrix (A - offset) / divisors, A (n, M), evaluated by column chunks.

    offset (n,); divisors (M,), one per column; total: sum of the squared norms of its columns;
    product: inner product (of matrix X) in which norms and orthogonality are meant.
    """

    A: FloatArray
    offset: FloatArray
    divisors: FloatArray
    total: float
    product: InnerProduct

    @classmethod
    def of(
        cls, A: FloatArray, offset: FloatArray, weighted: bool, product: InnerProduct
    ) -> "Snapshots":
        """Snapshots A (n, M) less `offset` (n,); weighted: each column is divided by the square
        root of its norm."""
        norms = np.concatenate([
            product.norms(part - offset[:, None]) for _, part in column_chunks(A)])
        divisors = np.ones(len(norms))
        if weighted:
            divisors = np.sqrt(np.where(norms > 0.0, norms, 1.0))
        return cls(A, offset, divisors, float(np.sum((norms / divisors) ** 2)), product)

    def images(self, X: FloatArray) -> FloatArray:
        """Product (n, l) of the scaled snapshot matrix with X (M, l), in one pass."""
        Y: FloatArray = np.zeros((len(self.offset), X.shape[1]))
        for at, part in column_chunks(self.A):
            Y += self._changed(at, part) @ X[at]
        return Y

    def coefficients(self, Q: FloatArray) -> FloatArray:
        """Inner products (M, l) of the scaled snapshots with the columns of Q (n, l), in one
        pass."""
        XQ = self.product.times(Q)
        return np.concatenate([
            self._changed(at, part).T @ XQ for at, part in column_chunks(self.A)])

    def missed(self, Q: FloatArray, B: FloatArray) -> float:
        """Norm of the scaled snapshot matrix less Q B (root of the summed squares of its columns),
        computed from the entries in one pass."""
        return float(np.linalg.norm([
            self.product.norm(self._changed(at, part) - Q @ B[:, at])
            for at, part in column_chunks(self.A)]))

    def _changed(self, at: slice, part: FloatArray) -> FloatArray:
        return np.asarray((part - self.offset[:, None]) / self.divisors[at], dtype=np.float64)


def mean(A: FloatArray) -> FloatArray:
    """Mean (n,) of the columns of A (n, M)."""
    if not needs_chunks(A):
        return np.asarray(A.mean(axis=1))
    total: FloatArray = np.zeros(A.shape[0])
    for _, part in column_chunks(A):
        total += part.sum(axis=1)
    return np.asarray(total / A.shape[1])


@dataclass(frozen=True, slots=True, eq=False)
class Leading:
    """Leading left singular vectors U (n, l) and singular values (l,), decreasing.

    complete: True if the remainder is round-off; passes: number of passes over the snapshots.
    """

    U: FloatArray
    values: FloatArray
    complete: bool
    passes: int


def leading(
    snapshots: Snapshots, count: int | None, energy: float | None, level: float
) -> Leading | None:
    """Leading left singular vectors by randomized subspace iteration, orthonormal after each half
    step.

    `count` columns, or as many as reach the share `energy` of the squared norm, whichever is fewer;
    if neither is set, or round-off is reached first, all above the relative singular value `level`.
    None if more than about a third of min(n, M) columns would be needed.

    Halko, Martinsson and Tropp 2011, doi 10.1137/090771806, algorithm 4.4. Passes end when the kept
    columns gain at most 1e-4 of the squared norm that they miss. The random sketch depends on the
    shape of the matrix only, so the seed of a scene does not change the basis.
    """
    n, M = snapshots.A.shape
    rng = np.random.default_rng([n, M])
    most = max(min(n, M) // 3, min(n, M, FIRST))
    wanted = FIRST if count is None else count + max(EXTRA, count // 4)
    size, passes = min(wanted, n, M), 0
    Q: FloatArray = np.zeros((n, 0))
    while True:
        Q = _widened(snapshots, Q, size, rng)
        passes += 1
        found, passes = _settled(snapshots, Q, count, energy, level, passes)
        if found.complete or (count is not None and energy is None):
            return found
        if energy is not None and _reached(found.values, snapshots.total, energy):
            return found
        if count is not None and size >= wanted:
            return found
        if size >= most:
            return None
        size, Q = min(2 * size, most), found.U


def _widened(
    snapshots: Snapshots, Q: FloatArray, size: int, rng: np.random.Generator
) -> FloatArray:
    """Orthonormal columns (n, size): Q (n, l) and a Gaussian sketch of the remainder outside its
    span."""
    M = snapshots.A.shape[1]
    Y = snapshots.images(rng.standard_normal((M, size - Q.shape[1])))
    XQ = snapshots.product.times(Q)
    for _ in range(2):  # once leaves what cancellation brings back
        Y -= Q @ (XQ.T @ Y)
        Y = snapshots.product.qr(Y)[0]
    return np.hstack([Q, Y])


def _settled(
    snapshots: Snapshots, Q: FloatArray, count: int | None, energy: float | None, level: float,
    passes: int,
) -> tuple[Leading, int]:
    """Subspace iteration from Q (n, l) until the captured squared norm stagnates; also the number
    of passes so far."""
    before = -np.inf
    limit = passes + PASSES
    while True:
        Z = snapshots.coefficients(Q)
        W, s, Vt = svd(Z)  # Z^T = Q^T X A
        U, passes = Q @ Vt.T, passes + 1
        kept = _kept(s, snapshots.total, count, energy)
        held = float(s[:kept] @ s[:kept])
        rest = max(snapshots.total - held, 0.0)
        noise = min(level, round_off_level(*snapshots.A.shape)) * snapshots.product.amplified(U, s)
        if rest <= 1e-12 * snapshots.total:  # a difference of squares tells no more than this
            passes += 1
            if snapshots.missed(U, s[:, None] * W.T) <= 0.5 * noise:
                return Leading(U, s, True, passes), passes
        every = count is None and energy is None  # widening finds more than going on
        if every or held - before <= SETTLED * rest or passes >= limit:
            return Leading(U, s, False, passes), passes
        before, passes = held, passes + 1
        Q = snapshots.product.qr(snapshots.images(W))[0]


def _kept(s: FloatArray, total: float, count: int | None, energy: float | None) -> int:
    kept = len(s) if count is None else min(count, len(s))
    if energy is not None:
        enough = np.flatnonzero(total - np.cumsum(s * s) <= (1.0 - energy) * total)
        kept = min(kept, int(enough[0]) + 1) if enough.size else kept
    return kept


def _reached(s: FloatArray, total: float, energy: float) -> bool:
    """True if the columns without the last `EXTRA` (oversampling) ones reach the share `energy`."""
    inner = s[: max(len(s) - EXTRA, 1)]
    return bool(total - float(inner @ inner) <= (1.0 - energy) * total)
