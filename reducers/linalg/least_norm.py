"""Least-squares solutions of least norm of square linear systems that may be singular."""

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import LinearOperator, onenormest, splu

from sparsemor.core import Csr, FloatArray

SINGULAR = 1e-10
"""Singular values below this fraction of the largest one count as zero."""


def least(A: FloatArray | Csr, r: FloatArray) -> FloatArray:
    """Least-squares solution of least norm of A z = r, with scaled rows and columns."""
    if not len(r):
        return r
    if not isinstance(A, np.ndarray):
        return sparse_least(A, r)
    size = np.sqrt(np.maximum(np.abs(A).max(axis=0), 1e-300))
    return np.asarray(
        np.linalg.lstsq(A / np.outer(size, size), r / size, rcond=SINGULAR)[0] / size)


def sparse_least(A: Csr, r: FloatArray) -> FloatArray:
    """Least-squares solution of least norm of A z = r (`least`) for a sparse matrix A (n, n), by
    sparse LU where an estimate of its condition number (Higham and Tisseur 2000, doi
    10.1137/S0895479899356080) shows that A is regular, else by a dense matrix."""
    size = np.sqrt(np.maximum(abs(A).max(axis=0).toarray().ravel(), 1e-300))
    S = csc_array(A)  # scaled below: entry (i, j) divided by size_i size_j
    scaled = csc_array(
        (S.data / (size[S.indices] * np.repeat(size, np.diff(S.indptr))), S.indices, S.indptr),
        shape=S.shape)
    try:
        factor = splu(scaled)
    except RuntimeError:
        return least(A.toarray(), r)
    inverse = LinearOperator(
        S.shape, matvec=factor.solve, rmatvec=lambda x: factor.solve(x, "T"), dtype=np.float64)
    # one column: with more, the estimate would start from random ones
    condition = float(onenormest(inverse, t=1)) * float(abs(scaled).sum(axis=0).max())
    if not 10.0 * SINGULAR * condition < 1.0:
        return least(A.toarray(), r)
    return np.asarray(factor.solve(r / size) / size)
