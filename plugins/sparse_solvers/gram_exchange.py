"""Exchange of active columns by normal equations, with a Gram matrix that is computed once.

With unit columns J (m, k), the residual r at the least-squares solution z on the active columns,
and its correlations g = J^T r (zero on these), the least-squares solution on a wider set U is z + d
with

    (J_U^T J_U) d = -g_U

so that an exchange costs one product with J and two Cholesky factorizations, where a QR
factorization of the m rows of U would cost several times as much. Normal equations square the
condition number: sets of columns for which that costs too many digits are left to QR. The residual
on the new columns is refined once (corrected semi-normal equations: Bjorck 1987, doi
10.1016/0024-3795(87)90101-7).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from sparsemor.core import BoolArray, FloatArray, IntArray

LARGEST = 4096
"""Number of columns up to which their Gram matrix is stored (134 MB)."""
LEAST_RCOND = 1e-9
"""Reciprocal condition number of a Gram matrix below which QR is used."""


class Exchanged(NamedTuple):
    """Active columns (k,) after an exchange, their coefficients z (k,), and the residual r (m,)."""

    active: BoolArray
    z: FloatArray
    r: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class GramExchange:
    """Columns J (m, k) as rows of `transposed` (k, m); gram (k, k): J^T J, None where it would be
    too large to store."""

    transposed: FloatArray
    gram: FloatArray | None

    @classmethod
    def from_matrix(cls, J: FloatArray) -> "GramExchange":
        rows = np.ascontiguousarray(J.T)
        return cls(rows, rows @ rows.T if len(rows) <= LARGEST else None)

    def correlations(self, r: FloatArray) -> FloatArray:
        """J^T r (k,)."""
        return np.asarray(self.transposed.dot(r))

    def exchanged(
        self, r: FloatArray, z: FloatArray, g: FloatArray, active: BoolArray, union: BoolArray,
        budget: int,
    ) -> Exchanged | None:
        """The `budget` largest coefficients of least squares on the columns `union`, which include
        the active ones, and least squares on these; None where that needs QR.

        z (k,), r (m,): least-squares solution on `active` and its residual, which a change d of the
        coefficients turns into r + J d; g = J^T r. Hence (J_U^T J_U) d = -g_U on the columns U.
        transposed (k, m): J^T.
        """
        wide = np.flatnonzero(union)
        factor = self._factor(wide)
        if factor is None:
            return None
        size = np.abs(z[wide] + _solved(factor, -g[wide]))
        kept = wide
        if budget < len(wide):
            kept = np.sort(wide[size.argpartition(len(wide) - budget)[len(wide) - budget :]])
        mask = np.zeros(len(active), dtype=np.bool_)
        mask[kept] = True
        if (mask == active).all():
            return Exchanged(active, z, r)
        factor = self._factor(kept)
        if factor is None:
            return None
        gone = np.flatnonzero(active & ~mask)
        near = self.transposed[kept]
        r = r - z[gone].dot(self.transposed[gone])  # the coefficients that leave become 0
        new = np.zeros(len(z))
        new[kept] = z[kept]
        for _ in range(2):  # the second pass corrects the rounding of the first
            d = _solved(factor, -near.dot(r))
            new[kept] += d
            r = r + d.dot(near)
        return Exchanged(mask, new, r)

    def _factor(self, columns: IntArray) -> FloatArray | None:
        """Lower Cholesky factor of the Gram matrix J_U^T J_U of the columns U with these numbers;
        None if that is too ill conditioned. transposed (k, m): J^T; gram (k, k): J^T J, None where
        it would be too large to store."""
        if self.gram is None:
            rows = self.transposed[columns]
            G = rows @ rows.T
        else:
            G = self.gram[np.ix_(columns, columns)]
        size = float(np.abs(G).sum(axis=0).max(initial=0.0))  # 1-norm, for its condition number
        factor, info = lapack.dpotrf(G, lower=1)
        if info or not float(lapack.dpocon(factor, size, uplo="L")[0]) > LEAST_RCOND:
            return None
        return np.asarray(factor)


def _solved(factor: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(lapack.dpotrs(factor, b, lower=1)[0])
