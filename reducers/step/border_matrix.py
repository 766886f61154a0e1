"""Matrix of the rigid coordinates and joint forces of a model, the sum of those of its bodies.

With the map T_i (b_i, N) of the N unknowns of the model to those of body i (the *border*,
frame_step.py) it is

    B = sum_i T_i^T H_i T_i.

An entry can differ from zero only where a body depends on both unknowns, so that their number grows
in proportion to the number of bodies. Each is a fixed linear combination of the entries of all H_i:
one sparse product assembles B. Its rows and columns are divided by their largest entries; then it
is factorized by bands in Cuthill-McKee order (LAPACK), or, for trees and loops whose bands are
wide, by SuperLU.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import lapack
from scipy.sparse import coo_array, csc_array, csr_array, kron
from scipy.sparse.csgraph import reverse_cuthill_mckee

from sparsemor.core import Csr, FloatArray, IntArray
from sparsemor.reducers.step.jacobian_factors import Factor, SparseLu, check_pivots

WIDEST = 64
"""Largest half bandwidth at which a matrix is factorized by bands."""


class BorderMatrix:
    """Structure of B (N, N): rows, columns (nnz,) of the entries that can differ from zero, by
    columns; combination (nnz, sum b_i^2): each from all entries of the matrices H_i, by rows.

    Of the bands: order (N,) of the unknowns, half bandwidth `width`, and position of each entry in
    LAPACK's storage (3 width + 1, N), column by column. by_row (nnz,): entries in the order of
    their rows; row_starts, column_starts (N,): first entry of each row in that order, and of each
    column.
    """

    def __init__(self, maps: Sequence[FloatArray]) -> None:
        """maps: T_i (b_i, N) of each body."""
        self.size = n = maps[0].shape[1]
        # the diagonal is stored in any case: each row and column has an entry
        keys, sources, factors, first = [np.arange(n) * (n + 1)], [np.zeros(n, int)], [
            np.zeros(n)], 0
        for T in maps:
            used = np.flatnonzero(T.any(axis=0))
            M = csr_array(T[:, used].T)
            both = coo_array(kron(M, M))  # of T^T H T by rows, from H by rows
            i, j = np.divmod(both.row, max(len(used), 1))
            keys.append(used[j] * n + used[i])
            sources.append(both.col + first)
            factors.append(both.data)
            first += len(T) ** 2
        found, at = np.unique(np.concatenate(keys), return_inverse=True)
        self.columns, self.rows = np.divmod(found, n)
        self.combination = csr_array(
            (np.concatenate(factors), (at, np.concatenate(sources))), shape=(len(found), first))
        self.by_row = np.argsort(self.rows, kind="stable")
        self.row_starts = np.searchsorted(self.rows[self.by_row], np.arange(n))
        self.column_starts = np.searchsorted(self.columns, np.arange(n))
        pattern = csr_array(self.matrix(np.ones(len(found))))
        self.order: IntArray = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        rank = np.empty(n, dtype=np.int64)
        rank[self.order] = np.arange(n)
        i, j = rank[self.rows], rank[self.columns]
        self.width = w = int(np.abs(i - j).max(initial=0))
        self.position = j * (3 * w + 1) + 2 * w + i - j

    def assembled(self, H: FloatArray) -> FloatArray:
        """Entries (nnz,) of B from those of all matrices H_i, (sum b_i^2,)."""
        return np.asarray(self.combination.dot(H))

    def matrix(self, entries: FloatArray) -> Csr:
        """B (N, N), csc, with these entries (nnz,)."""
        return csc_array((entries, (self.rows, self.columns)), shape=(self.size, self.size))

    def magnitudes(self, entries: FloatArray, x: FloatArray) -> FloatArray:
        """Magnitudes (N,) of the terms of B x, |B| x for x >= 0 (N,)."""
        terms = np.abs(entries) * x[self.columns]
        return np.bincount(self.rows, terms, self.size).astype(np.float64)

    def factorized(self, entries: FloatArray) -> Factor:
        """Factorization of B. Raises RuntimeError where it is singular."""
        if self.width > WIDEST:
            return SparseLu(self.matrix(entries))
        return BandLu(self, entries)


class BandLu:
    """LU factorization by bands of A = diag(rows) B diag(columns), whose largest entries are 1, so
    that B^-1 = diag(columns) A^-1 diag(rows). Raises RuntimeError where B is singular or not
    finite."""

    __slots__ = ("columns", "lu", "order", "pivots", "rows", "width")

    def __init__(self, of: BorderMatrix, entries: FloatArray) -> None:
        sizes, self.order, self.width = np.abs(entries), of.order, of.width
        largest = np.maximum.reduceat(sizes[of.by_row], of.row_starts)
        rows = 1.0 / np.maximum(largest, 1e-300)
        scale = rows[of.rows]
        largest = np.maximum.reduceat(sizes * scale, of.column_starts)
        columns = 1.0 / np.maximum(largest, 1e-300)
        bands = np.zeros((of.size, 3 * self.width + 1))
        bands.reshape(-1)[of.position] = entries * scale * columns[of.columns]
        self.lu, self.pivots, info = lapack.dgbtrf(
            bands.T, self.width, self.width, overwrite_ab=1)
        check_pivots(info == 0, np.abs(self.lu[2 * self.width]))
        self.rows, self.columns = rows[self.order], columns[self.order]

    def solve(self, r: FloatArray) -> FloatArray:
        """Solution for a right-hand side r (n,) or (n, k)."""
        scaled = (r[self.order].T * self.rows).T
        x = lapack.dgbtrs(self.lu, self.width, self.width, scaled, self.pivots)[0]
        found = np.empty_like(r)
        found[self.order] = (x.T * self.columns).T
        return found
