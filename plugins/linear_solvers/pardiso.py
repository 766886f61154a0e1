"""Sparse Cholesky factorization by Intel's PARDISO."""

import weakref
from copy import copy
from typing import Any, ClassVar

import numpy as np
from scipy.sparse import csr_matrix, triu

from sparsemor.core import (
    Csr,
    DofLocations,
    FloatArray,
    LinearSolver,
    Solved,
    Status,
    not_solved,
    require,
    solved_directly,
    unsuitable_matrix,
)
from sparsemor.core.linalg.nested_dissection import factor_entries
from sparsemor.core.linalg.threads import limit_loaded_libraries

POSITIVE_DEFINITE = 2
"""PARDISO's matrix type for real, symmetric positive definite matrices."""


class Pardiso(LinearSolver):
    """Multi-threaded supernodal Cholesky factorization by Intel MKL Pardiso: fast to factorize.

    Needs the extra `pardiso`, about 1 GB of Intel's libraries. The environment variable
    SPARSEMOR_THREADS sets the number of threads (1 by default). Schenk and Gaertner 2004, doi
    10.1016/j.future.2003.07.011.
    """

    direct: ClassVar[bool] = True

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Solved:
        """Cholesky factor of A from its upper triangle; not solved where A is not positive
        definite."""
        require("pypardiso", "pardiso", "pardiso")
        fault = unsuitable_matrix("pardiso", A)
        if fault is not None:
            return fault
        if A.shape[0] == 0:
            return Solved("pardiso", A, direct=lambda b: b.copy())
        from pypardiso.pardiso_wrapper import PyPardisoError

        engine = _engine()
        upper = csr_matrix(triu(A, format="csr"))  # the wrapper asks for a matrix, not an array
        upper.sort_indices()
        try:
            engine.factorize(upper)
        except PyPardisoError as error:
            engine.free_memory(everything=True)
            return not_solved("pardiso", A, Status.SINGULAR, f"not positive definite: {error}")
        solve = _Solve(engine, upper)
        # permanent memory of analysis and factors, kB; the wrapper keeps a copy of the matrix
        held = 1024 * int(engine.get_iparm(16) + engine.get_iparm(17)) + 2 * 12 * int(upper.nnz)
        return solved_directly("pardiso", A, held, solve)

    def expected(self, A: Csr, places: DofLocations | None = None) -> int:
        """Estimated peak memory, bytes: the factor, and as much again for frontal matrices and
        copies."""
        return 2 * 12 * factor_entries(A, places)


def _engine() -> Any:
    """New PARDISO solver object; the package's own constructor would search the disk for the
    library every time."""
    from pypardiso import ps

    limit_loaded_libraries()  # MKL has come with it
    engine = copy(ps)
    engine.pt, engine.iparm = np.zeros_like(ps.pt), np.zeros_like(ps.iparm)
    engine.perm = ps.perm.copy()
    engine.set_matrix_type(POSITIVE_DEFINITE)
    return engine


class _Solve:
    """Solution by PARDISO's factors, which lie outside Python's memory and are freed with this
    object."""

    def __init__(self, engine: Any, upper: Any) -> None:
        self._engine, self._upper = engine, upper
        weakref.finalize(self, engine.free_memory, everything=True)

    def __call__(self, b: FloatArray) -> FloatArray:
        x = self._engine.solve(self._upper, np.asfortranarray(b, dtype=np.float64))
        return np.asarray(x).reshape(b.shape)
