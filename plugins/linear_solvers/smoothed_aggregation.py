"""Conjugate gradients preconditioned by algebraic multigrid with rigid-body modes."""

from typing import Any

import numpy as np
from pydantic import Field
from scipy.sparse import bsr_matrix, coo_array, csr_matrix

from sparsemor.core import (
    Csr,
    DofLocations,
    FloatArray,
    IntArray,
    LinearSolver,
    Solved,
    require,
    unsuitable_matrix,
)
from sparsemor.core.linalg.linear_solver_checks import is_vector_field, rigid_motions
from sparsemor.plugins.linear_solvers.conjugate_gradients import iterate

WORKING = 10
"""Peak memory of the multigrid setup in multiples of the matrix's memory."""


class SmoothedAggregation(LinearSolver):
    """Conjugate gradients preconditioned by one smoothed-aggregation multigrid cycle.

    For matrices whose factors do not fit in memory. Given the positions of the unknowns, the
    rigid-body modes are passed to the coarse levels, without which elasticity converges slowly.
    Needs the extra `amg`. Vanek, Mandel and Brezina 1996, doi 10.1007/BF02238511; PyAMG, doi
    10.21105/joss.05495.
    """

    rtol: float = Field(default=1e-10, gt=0.0, lt=1.0)
    """Convergence tolerance: residual norm of each right-hand side relative to its norm."""
    max_iterations: int = Field(default=200, ge=1)
    """Largest number of iterations for one right-hand side."""
    theta: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Strength threshold: matrix entries below this share of their diagonal entries count as no
    connection."""

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Solved:
        """Conjugate gradients with one multigrid cycle as preconditioner; nodes of which some
        unknowns are fixed are completed."""
        require("pyamg", "amg", "amg")
        fault = unsuitable_matrix("amg", A)
        if fault is not None:
            return fault
        if A.shape[0] == 0:
            return Solved("amg", A, direct=lambda b: b.copy())
        # A with all unknowns of each node, positions of A's unknowns in it, rigid-body modes of it
        whole, at, motions = _whole_nodes(A, places)
        levels = _hierarchy(whole, motions, self.theta)
        cycle = levels.aspreconditioner(cycle="V")
        size = whole.shape[0]

        def precondition(r: FloatArray) -> FloatArray:
            padded = np.zeros(size)
            padded[at] = r
            return np.asarray(cycle.matvec(padded))[at]

        def column(b: FloatArray, start: FloatArray | None) -> tuple[FloatArray, int]:
            return iterate(A, precondition, b, start, self.rtol, self.max_iterations)

        return Solved("amg", A, _bytes(levels), column=column, rtol=self.rtol)

    def expected(self, A: Csr, places: DofLocations | None = None) -> int:
        """Estimated peak memory of the multigrid setup, bytes."""
        return WORKING * 12 * int(A.nnz)


def _hierarchy(whole: Any, motions: FloatArray, theta: float) -> Any:
    """PyAMG hierarchy of the matrix `whole`, with the rigid-body modes `motions` as near-null
    space. theta: entries below this share of their diagonal entries are no connection.

    Chebyshev smoothing is symmetric, as conjugate gradients require, and with interpolation of
    least energy takes a third of the time of Gauss-Seidel sweeps.
    """
    import pyamg

    relax = ("chebyshev", {"degree": 2})
    # PyAMG draws the start of its eigenvalue estimates from NumPy's global generator
    before = np.random.get_state()
    np.random.seed(0)
    try:
        return pyamg.smoothed_aggregation_solver(
            whole, B=motions, symmetry="symmetric", strength=("symmetric", {"theta": theta}),
            smooth=("energy", {"krylov": "cg", "degree": 1}), presmoother=relax,
            postsmoother=relax, max_coarse=300, coarse_solver="splu")
    finally:
        np.random.set_state(before)


def _bytes(levels: Any) -> int:
    """Memory of the hierarchy's matrices, bytes."""
    matrices = [level.A for level in levels.levels]
    for level in levels.levels[:-1]:  # the coarsest has no transfer to a coarser one
        matrices += [level.P, level.R]
    return sum(M.data.nbytes + M.indices.nbytes + M.indptr.nbytes for M in matrices)


def _whole_nodes(A: Csr, places: DofLocations | None) -> tuple[Any, IntArray, FloatArray]:
    """Matrix A extended to all d unknowns of each node, positions of its unknowns, rigid-body
    modes.

    Blocks of d x d keep a node's displacements in one aggregate. Fixed displacements are included
    as decoupled rows.
    """
    n = A.shape[0]
    if places is None:
        return _short(A), np.arange(n), np.ones((n, 1))
    motions = rigid_motions(places)
    if not is_vector_field(places):
        return _short(A), np.arange(n), motions
    X, component = places.coordinates, np.maximum(places.component, 0)
    d = max(X.shape[1], int(component.max()) + 1)  # more with rotations
    new = np.ones(n, dtype=np.bool_)  # first unknown of a node
    new[1:] = (np.diff(component) <= 0) | np.any(np.diff(X, axis=0) != 0.0, axis=1)
    at = d * (np.cumsum(new) - 1) + component
    size = d * int(np.sum(new))
    extra = np.setdiff1d(np.arange(size), at)  # fixed displacements
    entries = A.tocoo()
    values = np.concatenate([entries.data, np.full(len(extra), float(A.diagonal().mean()))])
    rows, columns = (np.concatenate([at[i], extra]) for i in (entries.row, entries.col))
    whole = coo_array((values, (rows, columns)), shape=(size, size)).tocsr()
    padded = np.zeros((size, motions.shape[1]))
    padded[at] = motions
    return bsr_matrix(_short(whole), blocksize=(d, d)), at, padded


def _short(A: Csr) -> Csr:
    """Matrix A with 32-bit indices, the only ones that PyAMG's compiled part takes."""
    narrow = (A.data, A.indices.astype(np.int32), A.indptr.astype(np.int32))
    return csr_matrix(narrow, shape=A.shape)
