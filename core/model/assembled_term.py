"""Terms whose matrices are assembled once: equations at positions of the state vector."""

from dataclasses import dataclass, replace
from typing import ClassVar, Generic, Protocol, Self, TypeVar

from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray, Matrix
from sparsemor.core.protocols import ReducedTerm, Trial


class AssembledEquations(Protocol):
    """m rows of equations in n unknowns. linear: whether their matrices are constant."""

    linear: ClassVar[bool]

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Matrix: ...
    def restricted(self, keep: IntArray) -> Self:
        """The rows number `keep`."""
        ...

    def mapped(self, trial: Trial, left: FloatArray) -> ReducedTerm:
        """left (l, m) times the rows at x = offset + atoms xi."""
        ...

    def time_derivative(self, order: int, t: float, h: float) -> "AssembledEquations | None":
        """As `TimeDependent` has it."""
        ...


E = TypeVar("E", bound=AssembledEquations, covariant=True)


@dataclass(frozen=True, slots=True, eq=False)
class AssembledTerm(Generic[E]):
    """Equations at global `rows` (m,) and `columns` (n,); no element is visited.

    `source`: the part of the scene that it comes from.
    """

    rows: IntArray
    columns: IntArray
    equations: E
    source: str = ""
    elements: ClassVar[int] = 0

    @property
    def linear(self) -> bool:
        return self.equations.linear

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.equations.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        return csr_array(self.equations.jacobian(x, v, a, t, c1, c2))

    def time_derivative(
        self, order: int, t: float, h: float
    ) -> "AssembledTerm[AssembledEquations] | None":
        of_time = self.equations.time_derivative(order, t, h)
        return None if of_time is None else AssembledTerm(
            self.rows, self.columns, of_time, self.source)

    def restrict(self, keep: IntArray) -> "AssembledTerm[E]":
        return replace(self, rows=self.rows[keep], equations=self.equations.restricted(keep))

    def compress(self, trial: Trial, left: FloatArray) -> ReducedTerm:
        return self.equations.mapped(trial, left)
