"""Conjugate gradients with Jacobi (diagonal) preconditioning."""

from collections.abc import Callable

import numpy as np
from pydantic import Field
from scipy.linalg.blas import daxpy

from sparsemor.core import (
    Csr,
    DofLocations,
    FloatArray,
    LinearSolver,
    Solved,
    unsuitable_matrix,
)

Precondition = Callable[[FloatArray], FloatArray]
RESTARTS = 3


class ConjugateGradients(LinearSolver):
    """Conjugate gradients with Jacobi (diagonal) preconditioning, without a factorization.

    For implicit heat conduction, K_T + C / h with capacity C and step h, whose condition number
    does not grow with the mesh: 10 to 40 iterations. Not for elasticity. Hestenes and Stiefel 1952,
    doi 10.6028/jres.049.044.
    """

    rtol: float = Field(default=1e-10, gt=0.0, lt=1.0)
    """Convergence tolerance: residual norm of each right-hand side relative to its norm."""
    max_iterations: int = Field(default=1000, ge=1)
    """Largest number of iterations for one right-hand side."""

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Solved:
        fault = unsuitable_matrix("cg", A)
        if fault is not None:
            return fault
        inverse = 1.0 / A.diagonal()

        # one right-hand side, from `start` or zero: its solution and number of iterations
        def column(b: FloatArray, start: FloatArray | None) -> tuple[FloatArray, int]:
            return iterate(A, lambda r: inverse * r, b, start, self.rtol, self.max_iterations)

        return Solved("cg", A, inverse.nbytes, column=column, rtol=self.rtol)

    def expected(self, A: Csr, places: DofLocations | None = None) -> int:
        """Estimated peak memory, bytes: vectors, and a copy of the matrix while it is checked."""
        return 96 * int(A.shape[0]) + 12 * int(A.nnz)


def iterate(
    A: Csr, precondition: Precondition, b: FloatArray, start: FloatArray | None, rtol: float,
    limit: int,
) -> tuple[FloatArray, int]:
    """Solution x (n,) with norm(b - A x) <= rtol norm(b), or the last iterate; number of
    iterations. precondition: approximate inverse of A, times a residual; limit: most iterations.

    The residual that is updated by recurrence drifts from the true one; where the true one is still
    too large, the iteration is restarted.
    """
    x = np.zeros_like(b) if start is None else start.copy()
    target, count = rtol * float(np.linalg.norm(b)), 0
    if target == 0.0:
        return np.zeros_like(b), 0
    for _ in range(RESTARTS):
        r = b - A @ x
        if not np.linalg.norm(r) > target or count >= limit:  # also where it is nan
            break
        count += _descend(A, precondition, x, r, 0.9 * target, limit - count)
    return x, count


def _descend(
    A: Csr, precondition: Precondition, x: FloatArray, r: FloatArray, target: float, limit: int
) -> int:
    """Conjugate gradient iterations from x with residual r, both overwritten, until the norm of r
    is at most `target`, or `limit` of them; returns their number."""
    z = precondition(r)
    p, rho = z.copy(), float(r @ z)
    for count in range(1, limit + 1):
        q = A @ p
        curvature = float(p @ q)
        if not curvature > 0.0:  # not positive definite, or not finite: the outcome tells
            return count
        daxpy(p, x, a=rho / curvature)
        daxpy(q, r, a=-rho / curvature)
        if float(r @ r) <= target * target:
            return count
        z = precondition(r)
        rho, before = float(r @ z), rho
        p *= rho / before
        p += z
    return limit
