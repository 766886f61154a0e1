"""Sparse LU factorization of symmetric positive definite matrices by SuperLU (SciPy)."""

from collections.abc import Callable
from typing import Any, ClassVar, Literal

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from sparsemor.core import (
    Csr,
    DofLocations,
    FloatArray,
    InputError,
    IntArray,
    LinearSolver,
    Solved,
    Status,
    not_solved,
    solved_directly,
    unsuitable_matrix,
)
from sparsemor.core.linalg.nested_dissection import dissect, factor_entries

ENTRY = 12
"""Bytes of one entry of the factors: a value and its row index."""
SUPERLU = {"minimum_degree": "MMD_AT_PLUS_A", "columns": "COLAMD", "dissection": "NATURAL"}
WORKING = 1.2
"""Peak memory of SuperLU's factorization relative to that of the factors."""
CHUNK = 32
"""Largest number of right-hand sides that SuperLU solves at once: more do not stay in the
processor's cache. For 1000 of them, CPU time falls from 1.8 to 1.0 s (brake_disk, 7018 unknowns)
and from 1.1 to 0.4 s (10 000 unknowns in the plane); 16 to 64 take the same."""
WORTH = 5000
"""Number of unknowns from which nested dissection is used in 3-D."""


class Splu(LinearSolver):
    """Sparse LU factorization by SuperLU (scipy): needs no extra package.

    Demmel, Eisenstat, Gilbert, Li and Liu 1999, doi 10.1137/S0895479895291765.
    """

    direct: ClassVar[bool] = True

    ordering: Literal["best", "dissection", "minimum_degree", "columns"] = "best"
    """Elimination order. `dissection`: nested dissection by the nodes' positions; `minimum_degree`:
    minimum degree on the symmetric pattern; `columns`: SciPy's default, which ignores the symmetry;
    `best`: dissection in 3-D from 5000 unknowns on, where positions are known, else minimum
    degree."""
    symmetric: bool = True
    """Pivots from the diagonal only: half the time and fill, and safe for positive definite
    matrices."""

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Solved:
        """LU factors of A in the chosen elimination order."""
        fault = unsuitable_matrix("splu", A)
        if fault is not None:
            return fault
        if A.shape[0] == 0:
            return Solved("splu", A, direct=lambda b: b.copy())
        ordering = self._ordering(A, places)
        order = None
        if ordering == "dissection" and places is not None:
            order = dissect(A, places).order
        options: dict[str, Any] = {}
        if self.symmetric:
            options = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        try:
            M = csc_array(A if order is None else A[order][:, order])
            lu = splu(M, permc_spec=SUPERLU[ordering], **options)
        except MemoryError:
            raise InputError(
                f"the factors of {A.shape[0]} unknowns do not fit in memory: take linear_solver "
                "cg or amg, or a coarser mesh") from None
        except RuntimeError as error:  # a pivot that is exactly zero
            return not_solved("splu", A, Status.SINGULAR, str(error))
        return solved_directly("splu", A, ENTRY * int(lu.nnz),
                               _ordered(chunked(lu.solve), order))

    def expected(self, A: Csr, places: DofLocations | None = None) -> int:
        """Estimated peak memory, bytes: SuperLU allocates more than it fills."""
        return int(WORKING * 2 * ENTRY * factor_entries(A, places))

    def _ordering(self, A: Csr, places: DofLocations | None) -> str:
        if self.ordering != "best":
            if self.ordering == "dissection" and places is None:
                raise InputError("dissection needs the positions of the unknowns", "ordering")
            return self.ordering
        in_space = places is not None and places.coordinates.shape[1] == 3
        return "dissection" if in_space and A.shape[0] >= WORTH else "minimum_degree"


def chunked(solve: Callable[[FloatArray], FloatArray]) -> Callable[[FloatArray], FloatArray]:
    """The same solver of A x = b, which solves for many columns of b in chunks of similar size, of
    at most `CHUNK` columns."""

    def by_chunks(b: FloatArray) -> FloatArray:
        if b.ndim == 1 or b.shape[1] <= CHUNK:
            return solve(b)
        x = np.empty(b.shape, order="F")
        ends = np.linspace(0, b.shape[1], -(-b.shape[1] // CHUNK) + 1).astype(int)
        for first, end in zip(ends, ends[1:], strict=False):
            x[:, first:end] = solve(b[:, first:end])
        return x

    return by_chunks


def _ordered(
    solve: Callable[[FloatArray], FloatArray], order: IntArray | None
) -> Callable[[FloatArray], FloatArray]:
    """The solver of a matrix permuted by `order`, for vectors in the original numbering."""
    if order is None:
        return solve

    def permuted(b: FloatArray) -> FloatArray:
        x = np.empty_like(b)
        x[order] = solve(b[order])
        return x

    return permuted
