"""Solution of a linear system of the whole model by Schur complement: large symmetric positive
definite blocks are eliminated first."""

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.model.factorizations import solve_or_fail
from sparsemor.core.protocols import AssembledModel

FEW = 3000
"""Number of unknowns up to which a block is not eliminated separately."""
BORDER = 300
"""Largest number of columns that couple a block to other unknowns for which elimination pays: each
costs one solve and n numbers."""


def solve_by_blocks(model: AssembledModel, A: Csr, r: FloatArray) -> FloatArray:
    """Solution A^-1 r of a system of the whole model, A (n, n) csr.

    Mass and capacity matrices of large blocks are factorized by the linear solvers that the user
    chose. The Schur complement of the remaining unknowns (rigid coordinates, multipliers, small or
    strongly coupled blocks) is solved as one sparse system. Raises RuntimeError if it is singular.
    """
    n = A.shape[0]
    border = np.ones(n, dtype=np.bool_)
    parts = []
    for name in model.reducible():
        at = model.layout[name]
        if at.stop - at.start <= FEW:
            continue
        own = np.arange(at.start, at.stop)
        right = csc_array(A[at])
        coupled = np.setdiff1d(np.flatnonzero(np.diff(right.indptr)), own)
        below = csc_array(A[:, at]).tocsr()
        coupled_rows = np.setdiff1d(np.flatnonzero(np.diff(below.indptr)), own)
        if len(coupled) > BORDER or not border[coupled].all() or not border[coupled_rows].all():
            continue
        border[own] = False
        parts.append((name, own, coupled, right[:, coupled].toarray(), below[coupled_rows],
                      coupled_rows))
    rest = np.flatnonzero(border)
    position = np.full(n, -1)
    position[rest] = np.arange(len(rest))
    S, b, answers = A[rest][:, rest].tolil(), r[rest].copy(), []
    for name, own, coupled, right, below, coupled_rows in parts:
        factor = model.factorize(name, A[own][:, own].tocsr(), "start")
        x = solve_or_fail(factor, np.column_stack([r[own], right]), name)
        answers.append(x)
        changed = below @ x
        b[position[coupled_rows]] -= changed[:, 0]
        _subtract(S, position[coupled_rows], position[coupled], changed[:, 1:])
    z = np.zeros(n)
    z[rest] = _scaled(S.tocsc(), b)
    for (_, own, coupled, *_), x in zip(parts, answers, strict=True):
        z[own] = x[:, 0] - x[:, 1:] @ z[coupled]
    return z


def _subtract(S: Csr, rows: IntArray, columns: IntArray, values: FloatArray) -> None:
    if len(rows) and len(columns):
        S[np.ix_(rows, columns)] = S[np.ix_(rows, columns)].toarray() - values


def _scaled(A: Csr, r: FloatArray) -> FloatArray:
    """Solution of A x = r by sparse LU after symmetric scaling, because rows and columns have very
    different units (forces, heat, lengths)."""
    if not len(r):
        return r
    size = np.sqrt(np.maximum(abs(A).max(axis=0).toarray().ravel(), 1e-300))
    S = A.copy()
    S.data = S.data / (size[S.indices] * np.repeat(size, np.diff(S.indptr)))
    return np.asarray(splu(S).solve(r / size) / size)
