"""Conjugate gradients, preconditioned by algebraic multigrid that knows rigid motions."""

from typing import Any

import numpy as np
from pydantic import Field
from scipy.sparse import bsr_matrix, coo_array, csr_matrix

from sparsemor.core import (
    Csr,
    DofLocations,
    FloatArray,
    IntArray,
    Plugin,
    Solved,
    is_vector_field,
    require,
    rigid_motions,
    unsuitable_matrix,
)
from sparsemor.plugins.linear_solvers.conjugate_gradients import iterate

WORKING = 10
"""Matrices as large as the given one that its hierarchy takes while it is made."""


class SmoothedAggregation(Plugin):
    """Conjugate gradients preconditioned by one smoothed-aggregation multigrid cycle.

    For what no direct solver holds in memory. Given the dof locations, it passes rigid motions
    down to the coarse levels, without which elasticity converges slowly. Needs the extra `amg`.
    Vanek, Mandel and Brezina 1996, doi 10.1007/BF02238511; PyAMG, doi 10.21105/joss.05495.
    """

    rtol: float = Field(default=1e-10, gt=0.0, lt=1.0)
    """Norm of the residual at which a column is solved, relative to its right-hand side's."""
    max_iterations: int = Field(default=200, ge=1)
    """Iterations of one column."""
    theta: float = Field(default=0.0, ge=0.0, lt=1.0)
    """Entries below this share of their diagonal entries count as no connection."""

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Solved:
        require("pyamg", "amg", "amg")
        fault = unsuitable_matrix("amg", A)
        if fault is not None:
            return fault
        if A.shape[0] == 0:
            return Solved("amg", A, direct=lambda b: b.copy())
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

        return Solved("amg", A, _held(levels), column=column, rtol=self.rtol)

    def expected(self, A: Csr, places: DofLocations | None = None) -> int:
        """Bytes while it works: what coarsening makes of the matrix on its way."""
        return WORKING * 12 * int(A.nnz)


def _hierarchy(whole: Any, motions: FloatArray, theta: float) -> Any:
    """PyAMG's levels. Chebyshev polynomials are symmetric, as conjugate gradients need it, and with
    interpolation of least energy take a third of the time of Gauss and Seidel's sweeps."""
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


def _held(levels: Any) -> int:
    """Bytes of the hierarchy's matrices."""
    matrices = [level.A for level in levels.levels]
    for level in levels.levels[:-1]:  # the coarsest has no transfer to a coarser one
        matrices += [level.P, level.R]
    return sum(M.data.nbytes + M.indices.nbytes + M.indptr.nbytes for M in matrices)


def _whole_nodes(A: Csr, places: DofLocations | None) -> tuple[Any, IntArray, FloatArray]:
    """A with all d unknowns of each node, the places of the given ones in it, the rigid motions.

    Blocks of d x d keep a node's displacements in one aggregate. Displacements that are held come
    back as rows of their own, which nothing couples to.
    """
    n = A.shape[0]
    if places is None:
        return _short(A), np.arange(n), np.ones((n, 1))
    motions = rigid_motions(places)
    if not is_vector_field(places):
        return _short(A), np.arange(n), motions
    X, component, d = places.coordinates, places.component, places.coordinates.shape[1]
    new = np.ones(n, dtype=np.bool_)
    new[1:] = (np.diff(component) <= 0) | np.any(np.diff(X, axis=0) != 0.0, axis=1)
    at = d * (np.cumsum(new) - 1) + component
    size = d * int(np.sum(new))
    extra = np.setdiff1d(np.arange(size), at)
    entries = A.tocoo()
    values = np.concatenate([entries.data, np.full(len(extra), float(A.diagonal().mean()))])
    rows, columns = (np.concatenate([at[i], extra]) for i in (entries.row, entries.col))
    whole = coo_array((values, (rows, columns)), shape=(size, size)).tocsr()
    padded = np.zeros((size, motions.shape[1]))
    padded[at] = motions
    return bsr_matrix(_short(whole), blocksize=(d, d)), at, padded


def _short(A: Csr) -> Csr:
    """A with 32-bit indices: PyAMG's compiled part takes no others."""
    narrow = (A.data, A.indices.astype(np.int32), A.indptr.astype(np.int32))
    return csr_matrix(narrow, shape=A.shape)
