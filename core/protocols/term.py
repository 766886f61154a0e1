"""Terms of the equations, whole and reduced."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from sparsemor.core.arrays import Csr, FloatArray, IntArray


@runtime_checkable
class Term(Protocol):
    """A sum of equations' parts: rows it adds to, columns (stencil) it reads.

    `rows` (m,) and `columns` (n,) are positions in the layout's flat vector. `x, v, a` are the
    unknowns and their rates *at `columns`*, shape (n,); `t` in s. Laws, tested on every term:

    * `restrict(keep).residual(...) == residual(...)[keep]`, likewise the Jacobian, where the
      restricted term may have a smaller stencil;
    * `compress(trial, left).residual(xi, ...) == left @ residual(offset + atoms xi, ...)`.
    """

    @property
    def rows(self) -> IntArray: ...
    @property
    def columns(self) -> IntArray: ...
    @property
    def elements(self) -> int:
        """Number of mesh elements that one evaluation visits (0 for constant matrices)."""
        ...

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        """d residual / dx where dv = c1 dx, da = c2 dx (c1, c2 of shape (n,)); (m, n)."""
        ...

    def restrict(self, keep: IntArray) -> "Term":
        """The rows number `keep` (positions in `rows`) of this term."""
        ...

    def compress(self, trial: "Trial", left: FloatArray) -> "ReducedTerm":
        """left (l, m): what `left @ residual` is as a function of reduced unknowns."""
        ...


@runtime_checkable
class HasConstantMatrices(Protocol):
    """A term that states whether its residual is K x + C v + M a - f(t) with constant matrices,
    which are then assembled once."""

    @property
    def linear(self) -> bool: ...


@runtime_checkable
class NamesSource(Protocol):
    """A term with the name of the scene entry that it comes from.

    The assembly sets the name: `source` is a dataclass field, and "" in the term as it is made.
    """

    @property
    def source(self) -> str: ...


@runtime_checkable
class ChecksStep(Protocol):
    """A term or reduced term that can reject the end of a step although it converged."""

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Why the end of a step of about h, s, is wrong, "" where it is not. x, v (n,) at the
        term's columns, t in s."""
        ...


@runtime_checkable
class ReportsResultants(Protocol):
    """A term or reduced term with resultants, such as a contact: forces, power, areas.

    source: name of the scene entry; histories: names of the resultants; empty for a reduced
    term that does not evaluate all that they need.
    """

    @property
    def source(self) -> str: ...
    @property
    def histories(self) -> tuple[str, ...]: ...
    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]:
        """Name -> value at x, v (n,) at the term's columns, and t, s."""
        ...


@runtime_checkable
class WrapsTerm(Protocol):
    """A reduced term that evaluates an unreduced one.

    source: name of the scene entry; histories: names of the resultants that it still knows.
    """

    @property
    def term(self) -> object: ...
    @property
    def source(self) -> str: ...
    @property
    def histories(self) -> tuple[str, ...]: ...


@runtime_checkable
class RelocatesNear(Protocol):
    """A reduced term with a cheaper copy that is exact near a state, such as a contact with a list
    of neighbours. The copy has the members of this term, `holds(x)` and the state `at`."""

    def near(self, x: FloatArray) -> "LocalCopy": ...


@runtime_checkable
class TimeDependent(Protocol):
    """A term that knows how its constraint rows depend on time alone.

    Optional for terms with rows of multipliers: of others, the start of a run takes finite
    differences in time.
    """

    def time_derivative(self, order: int, t: float, h: float) -> Term | None:
        """The partial derivative of order 1 or 2 by time, from the right at t, s, as a term whose
        constraint rows are valid at t; None where it is zero. h: time step, s."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """The affine map from reduced unknowns to a term's columns: x = offset + atoms @ xi.

    atoms (n, k), offset (n,) at the term's own columns; v = atoms @ xi', a = atoms @ xi''.
    """

    atoms: FloatArray
    offset: FloatArray


class ReducedTerm(Protocol):
    """A compressed term: (k,) reduced unknowns and rates -> (l,) rows, (l, k) Jacobian.

    c1, c2 (k,). `elements`: number of mesh elements that one evaluation visits.
    """

    @property
    def elements(self) -> int: ...
    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray: ...


class LocalCopy(ReducedTerm, ChecksStep, Protocol):
    """A copy of a reduced term for states near one. at (k,): the state that it was made at."""

    @property
    def at(self) -> FloatArray: ...
    def holds(self, x: FloatArray) -> bool:
        """True if the copy is exact at x (k,)."""
        ...

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]: ...
