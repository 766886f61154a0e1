"""Common parts of linear solvers: checks of matrices and residuals, rigid-body modes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.errors import InputError
from sparsemor.core.protocols.linear_solver import DofLocations, LinearOutcome
from sparsemor.core.status import Status

Column = Callable[[FloatArray, FloatArray | None], tuple[FloatArray, int]]
"""Iterative solver of one system: right-hand side (n,) and initial guess (n,) or None -> solution
(n,), iterations."""
SINGULAR = 1e-6
"""Relative residual of a direct solution for a random right-hand side, above which the matrix
counts as singular."""


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """Result of a factorization (protocol `Factorized`), from a function that solves.

    direct: solves for b (n, j) as a whole; or column: solves iteratively for one right-hand side at
    a time, to a relative residual of at most `rtol`. memory: bytes of the factors.
    """

    solver: str
    A: Csr
    memory: int = 0
    direct: Callable[[FloatArray], FloatArray] | None = None
    column: Column | None = None
    rtol: float = SINGULAR
    status: Status = Status.DONE
    note: str = ""

    @property
    def iterative(self) -> bool:
        return self.direct is None

    def solve(self, b: FloatArray, start: FloatArray | None = None) -> FloatArray:
        if self.direct is not None and self.status.ok and b.size:
            _same_size(self.A, b)
            return self.direct(b)
        return self._outcome(b, start)[0]

    def outcome(self, b: FloatArray, start: FloatArray | None = None) -> LinearOutcome:
        _, x, status, iterations, residual = self._outcome(b, start)
        return LinearOutcome(x, status, iterations, residual)

    def _outcome(
        self, b: FloatArray, start: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, Status, int, float]:
        """Solution with nan in columns that did not converge, solution as computed, status,
        iterations, largest relative residual."""
        _same_size(self.A, b)
        wide = b.reshape(len(b), -1)
        if not self.status.ok:
            return np.full_like(b, np.nan), np.full_like(b, np.nan), self.status, 0, np.inf
        first = None if start is None else start.reshape(wide.shape)
        x, iterations = self._columns(wide, first)
        left = relative_residuals(self.A, x, wide)
        bad = ~(left <= self.rtol)
        status = Status.DONE
        if bad.any():
            finite = np.isfinite(wide).all() and np.isfinite(x).all()
            status = Status.NOT_CONVERGED if finite else Status.NOT_FINITE
        marked = np.where(bad, np.nan, x) if bad.any() else x
        worst = float(np.where(np.isnan(left), np.inf, left).max(initial=0.0))
        return marked.reshape(b.shape), x.reshape(b.shape), status, iterations, worst

    def _columns(self, b: FloatArray, start: FloatArray | None) -> tuple[FloatArray, int]:
        """Solution for each column of b (n, k), from those of `start` where the solver iterates,
        and the largest number of iterations."""
        if not b.size:
            return b.copy(), 0
        if self.direct is not None:
            return self.direct(b).reshape(b.shape), 0
        assert self.column is not None
        x, most = np.empty_like(b), 0
        for j in range(b.shape[1]):
            guess = None if start is None else np.ascontiguousarray(start[:, j])
            x[:, j], count = self.column(np.ascontiguousarray(b[:, j]), guess)
            most = max(most, count)
        return x, most


def not_solved(solver: str, A: Csr, status: Status, why: str) -> Solved:
    """Result of a factorization that failed; why: the reason, in words."""
    return Solved(solver, A, direct=lambda b: np.full_like(b, np.nan), status=status, note=why)


def solved_directly(
    solver: str, A: Csr, memory: int, apply: Callable[[FloatArray], FloatArray]
) -> Solved:
    """Result of a direct factorization; status SINGULAR if a random right-hand side shows that A is
    singular or not positive definite: without pivoting, round-off hides a pivot that should be
    zero. apply: b (n, j) -> A^-1 b; memory: bytes of the factors."""
    b = np.random.default_rng(0).standard_normal((A.shape[0], 1))
    x = apply(b)
    left = relative_residuals(A, x, b).max(initial=0.0)
    if not left <= SINGULAR:
        return not_solved(solver, A, Status.SINGULAR,
                       f"singular to working precision: a random right-hand side keeps {left:.1e}")
    if float(np.vdot(x, b)) <= 0.0 and b.size:
        return not_solved(
            solver, A, Status.SINGULAR, "not positive definite: b A^-1 b < 0 for some b")
    return Solved(solver, A, memory, direct=apply)


def unsuitable_matrix(solver: str, A: Csr) -> Solved | None:
    """Failed result that states why A cannot be factorized; None when it can. Raises InputError
    when A is not square or not symmetric."""
    if A.ndim != 2 or A.shape[0] != A.shape[1]:
        raise InputError(f"{solver} solves square systems, not one of shape {A.shape}")
    if not np.isfinite(A.data).all():
        return not_solved(
            solver, A, Status.NOT_FINITE, "the matrix has values that are not finite")
    diagonal = A.diagonal()
    wrong = int(np.sum(diagonal <= 0.0))
    if wrong:
        return not_solved(solver, A, Status.SINGULAR, f"not positive definite: {wrong} of "
                       f"{len(diagonal)} diagonal entries are not positive")
    # of two random vectors, one product each way: cheaper than the difference of A and A^T
    v, w = np.random.default_rng(1).standard_normal((2, len(diagonal))) / np.sqrt(diagonal)
    one, other = float(v @ (A @ w)), float(w @ (A @ v))
    if abs(one - other) > 1e-9 * float(np.abs(v) @ (abs(A) @ np.abs(w))):
        raise InputError(f"{solver} solves symmetric systems; this matrix is not symmetric")
    return None


def relative_residuals(A: Csr, x: FloatArray, b: FloatArray) -> FloatArray:
    """Relative residuals (j,): norm(b - A x) / norm(b) of each column of x, b (n, j); norm(b - A x)
    where b is 0."""
    size = np.linalg.norm(b, axis=0)
    return np.asarray(np.linalg.norm(b - A @ x, axis=0) / np.where(size > 0.0, size, 1.0))


def is_vector_field(places: DofLocations) -> bool:
    """True if the unknowns are displacements, not temperatures."""
    return bool(places.component.any())


def rigid_motions(places: DofLocations) -> FloatArray:
    """Near-null space (n, r) of an operator on these unknowns, columns of similar size.

    Displacements: rigid-body modes, translations and rotations about the mean position, r = 3 (2-D)
    or 6 (3-D); components from d on are rotations. Temperatures: the constant, r = 1.
    """
    n, d = places.coordinates.shape
    if not is_vector_field(places):
        return np.ones((n, 1))
    X = places.coordinates - places.coordinates.mean(axis=0)
    size = max(float(np.abs(X).max(initial=0.0)), np.finfo(np.float64).tiny)
    pairs = [(i, j) for i in range(d) for j in range(i + 1, d)]
    unit = np.eye(d + len(pairs) + 1)[places.component]  # the last: modal coordinates
    # (y, z), (z, x), (x, y): the rotation about x, y, z, or in the plane the only one
    turns = [np.einsum("ni,ij,nj->n", unit[:, :d], _turn(d, i, j), X / size)
             + (1.0 if (i, j) != (0, 2) else -1.0) / size * unit[:, d + axis]
             for axis, (i, j) in enumerate(reversed(pairs))]
    return np.column_stack([unit[:, :d], *turns[::-1]])


def _turn(d: int, i: int, j: int) -> FloatArray:
    turn = np.zeros((d, d))
    turn[i, j], turn[j, i] = -1.0, 1.0
    return turn


def _same_size(A: Csr, b: FloatArray) -> None:
    if b.ndim not in (1, 2) or len(b) != A.shape[0]:
        raise InputError(f"a right-hand side of shape {b.shape} for {A.shape[0]} equations: give "
                         f"({A.shape[0]},) or ({A.shape[0]}, j)")
