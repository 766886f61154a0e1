"""LU factorizations of Jacobians: of reduced models with scaled rows and columns, and of full-order
ones by SuperLU."""

from typing import Any, Protocol, TypeAlias

import numpy as np
from scipy.linalg import lapack
from scipy.sparse import csc_array, issparse
from scipy.sparse.linalg import splu

from sparsemor.core import Csr, FloatArray

Matrix: TypeAlias = FloatArray | Csr


class Factor(Protocol):
    """A factorized Jacobian."""

    def solve(self, r: FloatArray) -> FloatArray: ...


MANY, FILLED = 300, 0.1
"""Number of unknowns, and largest share of entries that are not zero, from which and up to which a
Jacobian is factorized as a sparse one: that of a chain of many bodies."""


def factorized(J: Matrix) -> Factor:
    """LU factorization of J (n, n). Raises RuntimeError where it is singular."""
    if issparse(J):
        return SparseLu(J)
    if len(J) < MANY:
        return Inverse(J)
    sparse = csc_array(J)
    return SparseLu(sparse) if sparse.nnz <= FILLED * J.size else Lu(J)


class IdentityFactor:
    """Factorization of the identity."""

    def solve(self, r: FloatArray) -> FloatArray:
        return r


class Inverse:
    """Inverse of a small matrix: one product takes an eighth of the time of two triangular solves.
    Raises RuntimeError where the matrix is singular.

    It is computed from A = diag(rows) J diag(columns), whose largest entries are 1, as J^-1 =
    diag(columns) A^-1 diag(rows).
    """

    __slots__ = ("inverse",)

    def __init__(self, J: FloatArray) -> None:
        self.inverse = J
        if not len(J):
            return
        scaled, rows, columns = _scaled(J)
        lu, pivots, info = lapack.dgetrf(scaled, overwrite_a=1)
        check_pivots(info == 0, np.abs(np.diag(lu)))
        inverse = lapack.dgetri(lu, pivots, overwrite_lu=1)[0]
        self.inverse = np.ascontiguousarray(columns[:, None] * inverse * rows)

    def solve(self, r: FloatArray) -> FloatArray:
        """Solution for a right-hand side r (n,) or (n, k)."""
        return np.asarray(self.inverse.dot(r))


class Lu:
    """Dense LU factorization of A = diag(rows) J diag(columns), whose largest entries are 1, so
    that J^-1 = diag(columns) A^-1 diag(rows). Raises RuntimeError where J is singular."""

    __slots__ = ("columns", "lu", "pivots", "rows")

    def __init__(self, J: FloatArray) -> None:
        scaled, self.rows, self.columns = _scaled(J)
        self.lu, self.pivots, info = lapack.dgetrf(scaled, overwrite_a=1)
        diagonal = np.abs(np.diag(self.lu))
        check_pivots(info == 0, diagonal)

    def solve(self, r: FloatArray) -> FloatArray:
        """Solution for a right-hand side r (n,) or (n, k)."""
        x = lapack.dgetrs(self.lu, self.pivots, (r.T * self.rows).T)[0]
        return np.asarray((x.T * self.columns).T)


class SparseLu:
    """LU factorization by SuperLU of a Jacobian J (n, n), csc, with few entries that are not zero:
    of A = diag(rows) J diag(columns), whose largest entries are 1, so that J^-1 = diag(columns)
    A^-1 diag(rows). Raises RuntimeError where J is singular or not finite."""

    __slots__ = ("columns", "lu", "rows")

    def __init__(self, J: Csr) -> None:
        # self.rows, self.columns (n,): scales, 1 / largest entry of each row, then column; rows,
        # columns: row and column number of each stored entry; J is csc
        rows, entries = J.indices, np.abs(J.data)
        columns = np.repeat(np.arange(J.shape[1]), np.diff(J.indptr))
        largest = np.full(J.shape[0], 1e-300)
        np.maximum.at(largest, rows, entries)
        self.rows = 1.0 / largest
        largest = np.full(J.shape[1], 1e-300)
        np.maximum.at(largest, columns, entries * self.rows[rows])
        self.columns = 1.0 / largest
        scaled = J.data * self.rows[rows] * self.columns[columns]
        check_pivots(bool(np.isfinite(scaled).all()), np.ones(1))
        self.lu = splu(csc_array((scaled, J.indices, J.indptr), shape=J.shape))
        check_pivots(True, np.abs(self.lu.U.diagonal()))

    def solve(self, r: FloatArray) -> FloatArray:
        """Solution for a right-hand side r (n,) or (n, k)."""
        x = self.lu.solve((r.T * self.rows).T)
        return np.asarray((x.T * self.columns).T)


def superlu(matrix: Csr, threshold: float = 0.0) -> Any:
    """SuperLU factorization of a full-order Jacobian with the minimum-degree ordering for symmetric
    patterns, which takes half the time and fill of the default one. It is independent of the
    scene's linear solvers: local terms may make a Jacobian unsymmetric, and it changes in each
    iteration.

    threshold: a diagonal entry is used as pivot if it is at least this fraction of the largest
    entry of its column. Raises RuntimeError when the matrix is singular.
    """
    return splu(csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=threshold,
                options={"SymmetricMode": True})


def _scaled(J: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """J with rows, then columns divided by their largest entries, and the factors of both."""
    size = np.abs(J)
    rows = 1.0 / np.maximum(size.max(axis=1, initial=0.0), 1e-300)
    size *= rows[:, None]
    columns = 1.0 / np.maximum(size.max(axis=0, initial=0.0), 1e-300)
    return J * rows[:, None] * columns, rows, columns


def check_pivots(regular: bool, diagonal: FloatArray) -> None:
    """Raises RuntimeError for a factor whose pivots show that the matrix is singular."""
    if not regular or not diagonal.min(initial=1.0) > 1e-15 * diagonal.max(initial=0.0):
        raise RuntimeError("singular")
