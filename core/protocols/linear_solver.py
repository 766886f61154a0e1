"""Interfaces of linear solvers: one matrix, many right-hand sides."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Protocol

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols.plugin import Plugin
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True, eq=False)
class DofLocations:
    """Node and component of each unknown: coordinates (n, d) of its node, m; component (n,), 0..d-1
    for displacements, d and up for rotations, -1 for modal coordinates, 0 for temperatures.
    Unknowns of one node are adjacent."""

    coordinates: FloatArray
    component: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class LinearOutcome:
    """Solution x of A x = b with its status. iterations: maximum over the columns of b, 0 for a
    direct solver; residual: largest norm(b - A x) / norm(b) of all columns, recomputed from x."""

    x: FloatArray
    status: Status
    iterations: int
    residual: float


class Factorized(Protocol):
    """Factorized or preconditioned matrix A for many right-hand sides. Immutable: equal calls give
    equal results.

    solver: name of the plugin that made it (not "auto"); note: reason for the choice, or for a
    failure, "" if there is none. status: not ok if A is singular, not positive definite or not
    finite; all solutions are then nan. memory: bytes in addition to A. iterative: True for a solver
    that uses a first guess and may fail to converge.
    """

    @property
    def solver(self) -> str: ...
    @property
    def note(self) -> str: ...
    @property
    def status(self) -> Status: ...
    @property
    def memory(self) -> int: ...
    @property
    def iterative(self) -> bool: ...
    def solve(self, b: FloatArray, start: FloatArray | None = None) -> FloatArray:
        """Solution x for b (n,) or (n, j). start: first guess of the same shape, ignored by direct
        solvers. Columns that did not converge to tolerance are nan."""
        ...

    def outcome(self, b: FloatArray, start: FloatArray | None = None) -> LinearOutcome:
        """Solution for b (n,) or (n, j) with status and true residual; x is the best iterate even
        without convergence."""
        ...


class LinearSolver(Plugin):
    """Solver of A x = b with A (n, n) csr, symmetric positive definite. places: node coordinates
    and components of the unknowns, or None."""

    @abstractmethod
    def factorize(self, A: Csr, places: DofLocations | None = None) -> Factorized:
        """Factorization of A. Raises InputError if A is not square, not symmetric or does not fit
        in memory."""

    def expected(self, A: Csr, places: DofLocations | None = None) -> int | None:
        """Peak memory, bytes, of `factorize` for a matrix with the sparsity pattern of A; None if
        it is not known. A run that does not fit is refused."""
        return None

    @property
    def direct(self) -> bool:
        """True for factors whose fill-in is checked against the available memory before a mesh is
        made."""
        return False
