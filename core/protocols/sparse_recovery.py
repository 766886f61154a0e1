"""Few active atoms: the problem, where a search starts, and what it finds."""

from dataclasses import dataclass
from typing import Protocol

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True)
class Group:
    """Columns `start:stop` of a sparse problem. budget None: always active, not penalised."""

    name: str
    start: int
    stop: int
    budget: int | None


class SparseProblem(Protocol):
    """Find c with few active entries per group so that residual(c) is least in the 2-norm.

    Rows come scaled: they may be compared and summed. `needs`: names of `core.capabilities`.
    """

    @property
    def needs(self) -> frozenset[str]: ...
    @property
    def groups(self) -> tuple[Group, ...]: ...
    def residual(self, c: FloatArray) -> FloatArray: ...
    def jacobian(self, c: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, slots=True, eq=False)
class SparseStart:
    """First guess c (k,) and the support (k,) bool that earlier steps left active."""

    c: FloatArray
    support: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class SparseOutcome:
    """c (k,) is zero outside `support` in every budgeted group."""

    c: FloatArray
    support: BoolArray
    status: Status
    iterations: int
    residual_norm: float


class SparseSolver(Protocol):
    """`capabilities` (optional): names of `core.capabilities` it has; left out, it has them all."""

    def solve(self, problem: SparseProblem, start: SparseStart) -> SparseOutcome: ...
