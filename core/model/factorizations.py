"""Linear solvers of the blocks of a model, and reports of their factorizations."""

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from sparsemor.core.arrays import Csr, FloatArray
from sparsemor.core.model.block_patterns import matched_option
from sparsemor.core.protocols.linear_solver import DofLocations, Factorized, LinearSolver
from sparsemor.core.status import SolveFailed


@dataclass(slots=True)
class Factored:
    """Report on the factorizations for one block of unknowns and one purpose ("steps", "start").
    solver: plugin that made them, note: its reason; count: number of factorizations; seconds: their
    total time; memory: bytes of the largest one."""

    block: str
    purpose: str
    solver: str
    note: str
    unknowns: int
    iterative: bool
    count: int = 0
    seconds: float = 0.0
    memory: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class BlockSolvers:
    """Linear solvers of the blocks of unknowns: `default`, and `others` by block-name pattern such
    as `*.thermal`. log: reports on all factorizations so far."""

    default: LinearSolver
    others: Mapping[str, LinearSolver] = field(default_factory=dict)
    log: list[Factored] = field(default_factory=list)

    def of(self, block: str) -> LinearSolver:
        return matched_option(block, self.others, self.default)

    def factorize(
        self, block: str, A: Csr, places: DofLocations | None, purpose: str = "steps"
    ) -> Factorized:
        """Factorization of the matrix A (n, n) of a block. places: node coordinates of its
        unknowns. Raises SolveFailed for a matrix that is singular or not finite, and InputError for
        one that the solver does not accept."""
        start = time.perf_counter()
        made = self.of(block).factorize(A, places)
        if not made.status.ok:
            raise SolveFailed(made.status, 0.0, block, f"{made.solver}: {made.note}")
        self._record(block, purpose, made, A.shape[0], time.perf_counter() - start)
        return made

    def _record(
        self, block: str, purpose: str, made: Factorized, unknowns: int, seconds: float
    ) -> None:
        """Adds a factorization to the log, with those of the same block, purpose, solver and size
        in one entry."""
        key = (block, purpose, made.solver, unknowns)
        one = next((f for f in self.log if (f.block, f.purpose, f.solver, f.unknowns) == key), None)
        if one is None:
            one = Factored(block, purpose, made.solver, made.note, unknowns, made.iterative)
            self.log.append(one)
        one.count += 1
        one.seconds += seconds
        one.memory = max(one.memory, made.memory)


def factorizations_in(phase: str, log: Iterable[Factored]) -> list[Factored]:
    """Copies of the reports `log` with the run phase ("training", say) added to their purpose."""
    return [replace(f, purpose=f"{phase}, {f.purpose}") for f in log]


def solve_or_fail(
    factor: Factorized, b: FloatArray, block: str, start: FloatArray | None = None
) -> FloatArray:
    """Solution x of A x = b, b (n,) or (n, j), before the first time step. start: first guess of an
    iterative solver. Raises SolveFailed if the iteration does not converge."""
    if not factor.iterative:
        return factor.solve(b)
    found = factor.outcome(b, start)
    if not found.status.ok:
        raise SolveFailed(found.status, 0.0, block, unconverged_note(
            factor, found.residual, found.iterations))
    return found.x


def unconverged_note(factor: Factorized, residual: float, iterations: int) -> str:
    """Note on an iteration that stopped before convergence."""
    return (f"linear solver {factor.solver} left {residual:.1e} of its right-hand side after "
            f"{iterations} iterations")
