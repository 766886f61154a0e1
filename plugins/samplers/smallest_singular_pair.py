"""Smallest singular values of a matrix to which rows are added, without an SVD for each row."""

import numpy as np

from sparsemor.core import FloatArray
from sparsemor.core.linalg.dense import svd

EPS = float(np.finfo(np.float64).eps)
LOST = 1e4
"""Factor by which an updated quantity may shrink before it is computed again: it has lost four
digits."""
SMALL = 64
"""Number of columns up to which an SVD for each row is as fast as updates."""
ILL = 1e-6
"""Smallest singular value, relative to the largest, from which an inverse of A^T A is accurate
enough."""
CLOSE = 1e-6
"""Smallest distance of the shift from the smallest eigenvalue of A^T A, relative to that
eigenvalue."""
HELD = 4
"""Number of eigenvectors carried from row to row. With one more row, the first two are combinations
of the first three before and of the Krylov space of the new row: three would suffice."""
POWERS = 3
"""Number of Krylov blocks added before the iteration is restarted."""
EXACT = 1e-9
"""Residual of an eigenpair, relative to its eigenvalue, at which it counts as converged."""
CYCLES = 8
"""Largest number of restarts; then an SVD and a new shift are cheaper."""


class RowFactor:
    """Triangular factor R, R^T R = A^T A, of rows A (p, k) that are added; R has at most k rows.

    Updated by QR, not as A^T A, which would lose singular values below 1e-8 of the largest.
    """

    def __init__(self, A: FloatArray) -> None:
        self.R = _triangle(A)

    def add(self, rows: FloatArray) -> None:
        """Appends rows (q, k)."""
        self.R = _triangle(np.vstack([self.R, rows]))

    def singular(self, columns: int) -> tuple[FloatArray, FloatArray, int]:
        """Singular values s, right singular vectors V (j, j) and rank of the first j = `columns`
        columns.

        s has min(p, j) entries; the columns of V from `rank` on span the null space of the rows.
        """
        j = columns
        if self.R.shape[0] == 0:
            return np.zeros(0), np.eye(j), 0
        _, s, Vt = svd(self.R[:j, :j], full_matrices=True)
        return s, Vt.T, int(np.count_nonzero(s > EPS * j * s[0]))


def _triangle(A: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.qr(A, mode="r"), dtype=np.float64)


class Smallest:
    """Two smallest singular values of rows A (p, k) that are added, and the right vector of the
    smallest.

    They are the largest eigenpairs of M = (A^T A - shift)^-1, the shift a little below the smallest
    eigenvalue, which more rows only raise. A new row changes M by a rank-one update (Sherman and
    Morrison) and its eigenvectors little: block Krylov iterations with Rayleigh-Ritz from the
    previous ones take O(k^2) per row, where an SVD takes O(k^3). The SVD of all rows and a new
    shift are computed where the iterations become slow, where M has shrunk so far that its
    accumulated rounding errors matter, and for every row where A is nearly singular.

    s: (s_(k-1), s_k), the first infinite for k = 1; vector (k,): right singular vector of s_k.
    """

    def __init__(self, A: FloatArray) -> None:
        self.factor, self.later = RowFactor(A), list[FloatArray]()
        self._from_all()

    def add(self, rows: FloatArray) -> None:
        """Appends rows (q, k)."""
        self.later.append(rows)
        if self.M is None or not self._updated(self.M, rows):
            self._from_all()

    def _from_all(self) -> None:
        """Smallest singular values s = (s_(k-1), s_k) from the factor of all rows, the right vector
        of s_k, and for the next rows the inverse M = (A^T A - shift)^-1 by which they are updated;
        None: no updates, each row needs an SVD. later: rows that are not in the factor yet; held:
        leading eigenvectors of M; first: its largest eigenvalue."""
        if self.later:
            self.factor.add(np.concatenate(self.later))
            self.later.clear()
        k = self.factor.R.shape[1]
        s, V, rank = self.factor.singular(k)
        s = np.concatenate([[np.inf], s, np.zeros(k - s.size)])
        self.s, self.vector, self.M = s[-2:], V[:, -1], None
        # with few columns, or an ill-conditioned A, an SVD for each row instead
        if k > SMALL and rank == k and s[-1] > ILL * s[1]:
            least, above = s[:-3:-1] ** 2  # s_k^2, s_(k-1)^2
            # below the smallest eigenvalue, at least by a small part (CLOSE) of it
            self.shift = least - max(above - least, CLOSE * least)
            inverse = 1.0 / (s[1:] ** 2 - self.shift)
            self.M, self.held = (V * inverse) @ V.T, V[:, : -HELD - 1 : -1]
            self.first = inverse[-1]

    def _updated(self, M: FloatArray, rows: FloatArray) -> bool:
        """Updates M = (A^T A - shift)^-1 and its leading eigenvectors `held` by rows (q, k); False
        if these did not converge or M has lost digits: its largest eigenvalue has fallen far below
        the `first` one."""
        new = []
        for u in rows:
            b = M @ u
            M -= np.outer(b, b / (1.0 + float(u @ b)))
            new.append(b)
        values, X, converged = largest(M, np.column_stack([self.held, *new]), HELD)
        if not converged or values[0] * LOST < self.first:
            return False
        # eigenvalues of M descend, singular values are in the order (s_(k-1), s_k)
        self.s, self.vector, self.held = np.sqrt(self.shift + 1.0 / values[1::-1]), X[:, 0], X
        return True


def largest(
    M: FloatArray, start: FloatArray, count: int
) -> tuple[FloatArray, FloatArray, bool]:
    """Largest eigenvalues and eigenvectors of a symmetric matrix M (k, k), by block Krylov
    iterations.

    Returns `count` eigenvalues, descending, vectors (k, count) from the span of `start`, and
    whether the first two have converged. Blocks are orthonormalised by QR, which replaces dependent
    vectors by others. Saad 2011, doi 10.1137/1.9781611970739, ch. 6.
    """
    X, values = start, np.zeros(count)
    for _ in range(CYCLES):
        Q, MQ = _krylov(M, X)
        values, C = np.linalg.eigh(Q.T @ MQ)
        values, C = values[: -count - 1 : -1], C[:, : -count - 1 : -1]
        X = Q @ C
        off = np.linalg.norm(MQ @ C[:, :2] - X[:, :2] * values[:2], axis=0)
        if (off <= EXACT * values[:2]).all():
            return values, X, True
    return values, X, False


def _krylov(M: FloatArray, X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal basis Q of X, M X, ..., M^p X with p = `POWERS`, and M Q."""
    Q = np.linalg.qr(X)[0]
    images = [M @ Q]
    for _ in range(POWERS):
        new = images[-1]
        for _ in range(2):  # once leaves what rounding does to nearly dependent blocks
            new = np.linalg.qr(new - Q @ (Q.T @ new))[0]
        images.append(M @ new)
        Q = np.hstack([Q, new])
    return Q, np.hstack(images)
