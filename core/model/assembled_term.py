"""Residual terms with matrices assembled once, at given positions of the state vector."""

from dataclasses import dataclass, replace
from typing import ClassVar, Generic, Protocol, Self, TypeVar

from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray, Matrix
from sparsemor.core.protocols import ReducedTerm, Term, Trial


class AssembledEquations(Protocol):
    """m equations in n unknowns without loops over elements. linear: True for constant matrices."""

    linear: ClassVar[bool]

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Matrix: ...
    def restricted(self, keep: IntArray) -> Self:
        """The equations of the rows with numbers `keep`."""
        ...

    def mapped(self, trial: Trial, left: FloatArray) -> ReducedTerm:
        """Projection left @ r(offset + atoms xi) with a test basis `left` (l, m)."""
        ...

    def time_derivative(self, order: int, t: float, h: float) -> "AssembledEquations | None":
        """Partial time derivative of the constraint rows, of order 1 or 2, from the right at t (s);
        None if zero."""
        ...


E = TypeVar("E", bound=AssembledEquations, covariant=True)


@dataclass(frozen=True, slots=True, eq=False)
class AssembledTerm(Term, Generic[E]):
    """Residual term whose equations stand at global `rows` (m,) and `columns` (n,) of the state
    vector; no element is visited.

    source: name of the body, joint, contact or load that contributes it.
    """

    rows: IntArray
    columns: IntArray
    equations: E
    source: str = ""

    @property
    def exact_in_time(self) -> bool:
        return True

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
