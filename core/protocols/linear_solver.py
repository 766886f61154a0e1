"""Linear systems with one matrix and many right-hand sides."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True, eq=False)
class DofLocations:
    """Dof locations: coordinates (n, d) of the node of each unknown, m; component (n,) 0..d-1 for
    displacements, all 0 for temperatures (as in `BlockData`). Unknowns of a node are neighbours."""

    coordinates: FloatArray
    component: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class LinearOutcome:
    """x (n,) or (n, j), as b was. iterations: the most that a column took, 0 for a direct solver.
    residual: the largest norm(b - A x) / norm(b) of all columns, as computed from this x."""

    x: FloatArray
    status: Status
    iterations: int
    residual: float


class Factorized(Protocol):
    """A factorized or preconditioned matrix, for many right-hand sides. Immutable: equal calls give
    equal results.

    solver: name of the plugin that did it (not "auto"); note: a sentence on why, or on what failed,
    "" when there is nothing to say. status: not ok when A is found singular, not positive definite
    or not finite; then every solution is nan. memory: bytes that it holds in addition to A.
    iterative: whether a start helps, and a solve may stop short.
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
        """x of b (n,) or (n, j). start: a guess of the same shape, which direct solvers ignore.
        Columns that an iteration did not solve to its tolerance are nan: no loop misses that."""
        ...

    def outcome(self, b: FloatArray, start: FloatArray | None = None) -> LinearOutcome:
        """The same with its status and true residual; x is the best that was found."""
        ...


class LinearSolver(Protocol):
    """Linear solver of A x = b; A (n, n) csr, symmetric positive definite; places: node coordinates
    and components of its unknowns, where known.

    InputError when A is not square or not symmetric, or when it does not fit in memory.
    """

    def factorize(self, A: Csr, places: DofLocations | None = None) -> Factorized: ...


@runtime_checkable
class EstimatesMemory(Protocol):
    """A linear solver whose memory is known in advance; runs are refused on its account."""

    def expected(self, A: Csr, places: DofLocations | None = None) -> int:
        """Peak memory of `factorize`, bytes, for a matrix with the pattern of A."""
        ...


@runtime_checkable
class StatesFillIn(Protocol):
    """A linear solver that states whether its factors fill in, whatever memory there is."""

    @property
    def direct(self) -> bool: ...
