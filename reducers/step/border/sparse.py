"""Bordered systems of many bodies, stored by bands or compressed columns.

Entry (i, j) of B can differ from zero only where a body depends on both unknowns, so that the
number of entries grows in proportion to the number of bodies. Each is a fixed linear combination of
entries of the bodies' matrices H_i: one sparse product per iteration assembles B in the storage of
its factorization. The matrix is that of a saddle point, so both factorizations pivot:

  * bands after a Cuthill-McKee order (LAPACK dgbsv), for chains: 0.08 + 0.011 w us per
    unknown at the half bandwidth w;
  * SuperLU with column approximate minimum degree order, for trees, stars and loops, whose bands
    are wide: 30 us, and 0.045 us per entry of the factors.

The faster of the two by these measured costs is chosen once, from the structure alone. Beyond DENSE
unknowns it is also faster than dense matrices.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
from scipy.linalg.lapack import dgbsv
from scipy.sparse import coo_array, csc_array, csr_array, kron, vstack
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.sparse.linalg import splu

from sparsemor.core import Csr, FloatArray, IntArray
from sparsemor.reducers.linalg.least_norm import sparse_least
from sparsemor.reducers.step.border.system import BodyMatrices, BorderedSystem, DenseSystem

DENSE = 50
"""Largest number of rigid coordinates and multipliers for which matrices are dense."""
PER_UNKNOWN, PER_BAND, ONCE, PER_ENTRY = 0.08, 0.011, 30.0, 0.045
"""Costs of both factorizations, us."""
SAMPLES = 8
"""Number of sign vectors in the estimate of |B^-1| times a vector."""


def bordered_system(maps: Sequence[FloatArray], size: int, n_rigid: int) -> BorderedSystem:
    """Bordered system for the maps T_i (b_i, N) of all bodies, in the storage that is fastest."""
    if size <= DENSE:
        return DenseSystem(maps, size, n_rigid)
    pattern = Pattern(maps, size, n_rigid)
    bands = Bands(pattern)
    banded = size * (PER_UNKNOWN + PER_BAND * bands.width)
    if banded <= ONCE + PER_ENTRY * pattern.fill():
        return BandedSystem(pattern, bands)
    return ColumnSystem(pattern)


class Pattern:
    """Structure of a bordered system: maps T_i, and entries of B that can differ from zero.

    rows, columns (nnz,): their positions; combination (nnz + N, sum b (b + 1)): B, then r, of all
    entries of the bodies' matrices and rows. map: all T_i (sum b, N), rates: its columns of rigid
    coordinates.
    """

    def __init__(self, maps: Sequence[FloatArray], size: int, n_rigid: int) -> None:
        self.size, self.borders = size, [len(T) for T in maps]
        self.map = csr_array(vstack([csr_array(T) for T in maps]))
        self.rates, self.sizes = csr_array(self.map[:, :n_rigid]), abs(self.map)
        entries, sources, factors, first = [], [], [], 0
        for T in maps:
            used, b = np.flatnonzero(T.any(axis=0)), len(T)
            M = coo_array(T[:, used].T)
            both = coo_array(kron(M, np.pad(T[:, used].T, ((0, 0), (0, 1)))))  # of T^T H T, by rows
            i, j = np.divmod(both.row, len(used))
            entries += [used[j] * size + used[i], size**2 + used[M.row]]
            sources += [both.col + first, first + M.col * (b + 1) + b]
            factors += [both.data, M.data]
            first += b * (b + 1)
        found, at = np.unique(np.concatenate(entries), return_inverse=True)
        keys = found[found < size**2]
        self.columns, self.rows = np.divmod(keys, size)
        self.combination = csr_array(
            (np.concatenate(factors), (at, np.concatenate(sources))), shape=(len(found), first))

    def matrix(self, values: FloatArray) -> Csr:
        """The matrix with these entries (nnz,)."""
        return csc_array((values, (self.rows, self.columns)), shape=(self.size, self.size))

    def fill(self) -> int:
        """Number of entries of the factors of a matrix with this structure and random values."""
        values = np.random.default_rng(0).uniform(0.5, 1.5, len(self.rows))
        try:
            return int(splu(self.matrix(values)).nnz)
        except RuntimeError:  # a structure that no values make regular
            return len(self.rows)


class SparseSystem(ABC):
    """Bordered system whose nnz entries are stored in an array of `length` numbers, at positions
    `entries` (nnz,)."""

    def __init__(self, pattern: Pattern, entries: IntArray, length: int) -> None:
        self.pattern, self.entries = pattern, entries
        C, n = coo_array(pattern.combination), pattern.size
        places = np.concatenate((entries, length + np.arange(n)))
        self.combination: Csr = csr_array(
            (C.data, (places[C.row], C.col)), shape=(length + n, C.shape[1]))

    def matrices(self) -> BodyMatrices:
        edges = np.cumsum([0, *(b * (b + 1) for b in self.pattern.borders)]).tolist()
        values = np.zeros(edges[-1])
        return BodyMatrices(values, [values[first:last].reshape(b, b + 1) for first, last, b in zip(
            edges, edges[1:], self.pattern.borders, strict=False)])

    def stacked(self, x: FloatArray) -> FloatArray:
        return np.asarray(self.pattern.map @ x)

    def stacked_rates(self, v: FloatArray) -> FloatArray:
        return np.asarray(self.pattern.rates @ v)

    def stacked_sizes(self, x: FloatArray) -> FloatArray:
        return np.asarray(self.pattern.sizes @ x)

    def assembled(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        both, n = self.combination @ values, self.pattern.size
        return both[:-n], both[-n:]

    @abstractmethod
    def solved(self, B: FloatArray, r: FloatArray) -> FloatArray | None:
        """Solution for r (N,) or (N, k); not a number where B is not finite."""
        ...

    def least(self, B: FloatArray, r: FloatArray) -> FloatArray:
        return sparse_least(self.pattern.matrix(B[self.entries]), r)

    def term_sizes(self, B: FloatArray, x: FloatArray) -> FloatArray:
        p = self.pattern
        terms = np.abs(B[self.entries]) * x[p.columns]
        return np.bincount(p.rows, terms, p.size).astype(np.float64)

    def amplified(self, B: FloatArray, sizes: FloatArray) -> FloatArray:
        """Estimate: largest of the solutions for errors with random signs, the same in every call;
        0.4 to 0.7 of |B^-1| sizes for chains of 100 to 12 links. All N columns of the inverse,
        which is full, would cost a solution each."""
        signs = np.random.default_rng(0).integers(0, 2, (len(sizes), SAMPLES))
        found = self.solved(B, (2.0 * signs - 1.0) * sizes[:, None])
        return np.full(len(sizes), np.nan) if found is None else np.abs(found).max(axis=1)


class Bands:
    """Order (N,) of the unknowns in which the bands of a structurally symmetric matrix are narrow,
    their half `width`, and `rank` (N,), the place of each unknown in this order.

    Cuthill-McKee order: breadth first, neighbours by increasing degree, from an end of each
    connected part, found as the last unknown of two searches (George and Liu 1981, ISBN
    0131652745, Sec. 4.3).
    """

    def __init__(self, pattern: Pattern) -> None:
        A = csr_array(pattern.matrix(np.ones(len(pattern.rows))))
        by_degree = np.argsort(np.diff(A.indptr), kind="stable")
        A = csr_array(A[by_degree][:, by_degree])
        A.sort_indices()
        found = []
        for start in np.unique(connected_components(A)[1], return_index=True)[1].tolist():
            for _ in range(2):
                start = _breadth_first(A, start)[-1]
            found.append(_breadth_first(A, start))
        self.order: IntArray = by_degree[np.concatenate(found)]
        self.rank = np.empty(pattern.size, dtype=np.int64)
        self.rank[self.order] = np.arange(pattern.size)
        self.width = int(np.abs(self.rank[pattern.rows] - self.rank[pattern.columns]).max())


def _breadth_first(A: Csr, start: int) -> IntArray:
    return np.asarray(breadth_first_order(A, start, return_predecessors=False))


class BandedSystem(SparseSystem):
    """Bordered system stored by bands."""

    def __init__(self, pattern: Pattern, bands: Bands) -> None:
        self.order, self.width = bands.order, bands.width
        self.height = 3 * self.width + 1  # with room for the pivoting of dgbsv
        i, j = bands.rank[pattern.rows], bands.rank[pattern.columns]
        entries = j * self.height + 2 * self.width + i - j
        super().__init__(pattern, entries, pattern.size * self.height)

    def solved(self, B: FloatArray, r: FloatArray) -> FloatArray | None:
        bands, order, w = B.reshape(-1, self.height).T, self.order, self.width
        x, info = dgbsv(w, w, bands, r[order], overwrite_b=1)[2:]
        if info > 0:
            return None
        found = np.empty_like(r)
        found[order] = x
        return found


class ColumnSystem(SparseSystem):
    """Bordered system stored by compressed columns, factorized by SuperLU (Li 2005, doi
    10.1145/1089014.1089017)."""

    def __init__(self, pattern: Pattern) -> None:
        super().__init__(pattern, np.arange(len(pattern.rows)), len(pattern.rows))
        starts = np.searchsorted(pattern.columns, np.arange(pattern.size + 1))
        self.indices, self.starts = pattern.rows.astype(np.int32), starts.astype(np.int32)

    def solved(self, B: FloatArray, r: FloatArray) -> FloatArray | None:
        n = self.pattern.size
        if not np.isfinite(B).all():
            return np.full_like(r, np.nan)
        columns = csc_array((B, self.indices, self.starts), shape=(n, n))
        try:
            return np.asarray(splu(columns).solve(r))
        except RuntimeError:
            return None
