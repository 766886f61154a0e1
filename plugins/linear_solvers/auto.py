"""Automatic choice of a linear solver, from operation counts before a matrix is factorized."""

from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from pydantic import Field

from sparsemor.core import Csr, DofLocations, LinearSolver, Solved, unsuitable_matrix
from sparsemor.core.linalg.linear_solver_checks import is_vector_field
from sparsemor.core.linalg.nested_dissection import factor_entries
from sparsemor.core.simulation.memory.limits import GIGABYTE, machine_memory
from sparsemor.plugins.linear_solvers.superlu import ENTRY, Splu

SMALL = 3000
"""Number of unknowns up to which SuperLU is used, whatever else is installed."""
PATIENCE = 300
"""Iterations of conjugate gradients that are accepted if the factors do not fit in memory."""


class AutomaticSolver(LinearSolver):
    """Automatic choice: sparse direct if the factors fit in memory and pay off, else iterative.

    The size of the factors is that of nested dissection, computed before the factorization.
    Conjugate gradients are tried on one random right-hand side, for at most as many iterations as
    cost one solve with factors; costs are counted in matrix entries, so that all machines with the
    same packages and memory choose alike. Direct: `cholmod`, `pardiso` or `splu`, the first that is
    installed. Iterative: `cg`, or `amg` (if installed) for displacements and where `cg` takes more
    than 300 iterations.
    """
    # a solver is imported where it is chosen: most matrices are small, and take SuperLU

    rtol: float = Field(default=1e-10, gt=0.0, lt=1.0)
    """Tolerance of the iterative solvers: residual norm relative to that of the right-hand side."""
    memory: float | None = Field(default=None, gt=0.0)
    """Memory limit for the factors of one matrix, GB; if left out, half of the machine's memory, or
    of the environment variable SPARSEMOR_MEMORY."""

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Solved:
        fault = unsuitable_matrix("auto", A)
        if fault is not None:
            return fault
        solver, note = self.choose(A, places)
        done: Solved = solver.factorize(A, places)
        return replace(done, note="; ".join(filter(None, (note, done.note))))

    def choose(self, A: Csr, places: DofLocations | None = None) -> tuple[Any, str]:
        """Solver chosen for A (n, n), and the reason in words. places: positions of the unknowns,
        by which the elimination order and so the size of the factors is known."""
        n = A.shape[0]
        if n <= SMALL:
            return Splu(), f"splu: {n} unknowns are few"
        entries = factor_entries(A, places)
        # ENTRY: bytes of an entry
        size, limit = 2 * ENTRY * entries / GIGABYTE, self._limit()  # GB of both factors
        if size > limit:
            return self._iterative(A, places, f"factors of {size:.2g} GB exceed {limit:.2g} GB")
        # one solve visits both factors once, one iteration the matrix and six vectors; these are
        # read in order, and take half the time an entry
        worth = int(4 * entries / (A.nnz + 6 * n))
        took = self._tried(A, worth)
        if took is not None:
            from sparsemor.plugins.linear_solvers.conjugate_gradients import ConjugateGradients

            return ConjugateGradients(rtol=self.rtol), (
                f"cg: {took} iterations cost less than a solve with factors of {size:.2g} GB")
        name, best = _direct()
        return best, (f"{name}: factors of {size:.2g} GB fit in {limit:.2g} GB, and "
                      f"conjugate gradients take more than {worth} iterations")

    def expected(self, A: Csr, places: DofLocations | None = None) -> int:
        """Estimated peak memory of the chosen solver, bytes."""
        return int(self.choose(A, places)[0].expected(A, places))

    def _iterative(self, A: Csr, places: DofLocations | None, why: str) -> tuple[Any, str]:
        from sparsemor.plugins.linear_solvers.conjugate_gradients import ConjugateGradients
        from sparsemor.plugins.linear_solvers.smoothed_aggregation import SmoothedAggregation

        heat = places is None or not is_vector_field(places)
        took = self._tried(A, PATIENCE) if heat else None
        if took is None and find_spec("pyamg"):
            return SmoothedAggregation(rtol=self.rtol), f"amg: {why}"
        slow = "" if took is not None else "; install the extra amg, it is much faster here"
        return ConjugateGradients(rtol=self.rtol, max_iterations=20 * PATIENCE), f"cg: {why}{slow}"

    def _tried(self, A: Csr, limit: int) -> int | None:
        """Iterations of conjugate gradients for a random right-hand side; None when `limit` does
        not suffice."""
        from sparsemor.plugins.linear_solvers.conjugate_gradients import ConjugateGradients

        if limit < 1:
            return None
        b = np.random.default_rng(0).standard_normal(A.shape[0])
        cg = ConjugateGradients(rtol=self.rtol, max_iterations=limit)
        outcome = cg.factorize(A).outcome(b)
        return outcome.iterations if outcome.status.ok else None

    def _limit(self) -> float:
        """Memory limit for the factors, GB."""
        return 0.5 * machine_memory() / GIGABYTE if self.memory is None else self.memory


def _direct() -> tuple[str, LinearSolver]:
    """Name of the fastest installed direct solver, and the solver."""
    if find_spec("sksparse"):
        from sparsemor.plugins.linear_solvers.cholmod import Cholmod

        return "cholmod", Cholmod()
    if find_spec("pypardiso"):
        from sparsemor.plugins.linear_solvers.pardiso import Pardiso

        return "pardiso", Pardiso()
    return "splu", Splu()
