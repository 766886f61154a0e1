"""Sparse Cholesky factorization by CHOLMOD of SuiteSparse."""

from typing import ClassVar, Literal

from scipy.sparse import csc_matrix

from sparsemor.core import (
    Csr,
    DofLocations,
    LinearSolver,
    Solved,
    Status,
    not_solved,
    require,
    solved_directly,
    unsuitable_matrix,
)
from sparsemor.core.linalg.nested_dissection import factor_entries


class Cholmod(LinearSolver):
    """Supernodal Cholesky factorization by CHOLMOD: the fastest direct solves.

    Needs the extra `cholmod`: scikit-sparse, built against SuiteSparse (libsuitesparse-dev). Chen,
    Davis, Hager and Rajamanickam 2008, doi 10.1145/1391989.1391995.
    """

    direct: ClassVar[bool] = True

    ordering: Literal["default", "amd", "metis", "nesdis"] = "default"
    """Elimination order; `default` lets CHOLMOD try several."""

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Solved:
        """Supernodal Cholesky factor of A; not solved where A is not positive definite."""
        require("sksparse", "cholmod", "cholmod")
        fault = unsuitable_matrix("cholmod", A)
        if fault is not None:
            return fault
        if A.shape[0] == 0:
            return Solved("cholmod", A, direct=lambda b: b.copy())
        from sksparse.cholmod import CholmodError, analyze

        lower = csc_matrix(A)  # the wrapper asks for a matrix, not an array
        try:
            factor = analyze(lower, mode="supernodal", ordering_method=self.ordering)
            factor.cholesky_inplace(lower)
        except CholmodError as error:
            return not_solved("cholmod", A, Status.SINGULAR, f"not positive definite: {error}")
        # 12 bytes an entry: a value and its row index
        return solved_directly("cholmod", A, 12 * int(factor.L().nnz), factor)

    def expected(self, A: Csr, places: DofLocations | None = None) -> int:
        """Estimated peak memory, bytes: the factor, and as much again for frontal matrices and
        copies."""
        return 2 * 12 * factor_entries(A, places)
