"""Residual terms of the equations, and their projections on reduced bases."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from sparsemor.core.arrays import Csr, FloatArray, IntArray


@runtime_checkable
class Term(Protocol):
    """One additive contribution to the residual of the model, with the rows that it adds to and the
    columns (stencil) that it reads.

    rows (m,), columns (n,): positions in the state vector. x, v, a (n,): unknowns, rates and second
    derivatives at `columns`; t in s. Laws, tested for every term:

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
        """Derivative (m, n) of the residual by x, with dv = c1 dx and da = c2 dx; c1, c2 (n,)."""
        ...

    def restrict(self, keep: IntArray) -> "Term":
        """The term with only the rows at positions `keep` of `rows`."""
        ...

    def compress(self, trial: "Trial", left: FloatArray) -> "ReducedTerm":
        """Projected term left @ residual(offset + atoms xi), with test basis left (l, m), as a
        function of reduced unknowns xi."""
        ...


@runtime_checkable
class HasConstantMatrices(Protocol):
    """A term that states whether its residual is K x + C v + M a - f(t) with constant matrices,
    which are then assembled once."""

    @property
    def linear(self) -> bool: ...


@runtime_checkable
class NamesSource(Protocol):
    """A term with the name of the joint, contact, load or body that contributes it.

    The assembly sets the name: `source` is a dataclass field, "" until then.
    """

    @property
    def source(self) -> str: ...


@runtime_checkable
class ChecksStep(Protocol):
    """A term that can reject a time step although its iteration converged; it may be reduced."""

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Reason to reject a time step of about h, s, that ends at t, s; "" to accept it. x, v
        (n,): unknowns and rates at the term's columns."""
        ...


@runtime_checkable
class ReportsResultants(Protocol):
    """A term with force resultants or similar totals (power, contact area), such as a contact; it
    may be reduced.

    source: name of the contact or load; histories: names of the resultants, empty if a reduced term
    does not evaluate all elements that they need.
    """

    @property
    def source(self) -> str: ...
    @property
    def histories(self) -> tuple[str, ...]: ...
    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]:
        """Resultants by name at t, s; x, v (n,): unknowns and rates at the term's columns."""
        ...


@runtime_checkable
class WrapsTerm(Protocol):
    """A reduced term that evaluates an unreduced term and projects it.

    source: name of the contact or load; histories: names of the resultants that it can still
    evaluate.
    """

    @property
    def term(self) -> object: ...
    @property
    def source(self) -> str: ...
    @property
    def histories(self) -> tuple[str, ...]: ...


@runtime_checkable
class HasPoints(Protocol):
    """A term whose projection holds its variables and test functions at quadrature points.

    point_values: largest number of values per atom.
    """

    @property
    def point_values(self) -> int: ...


@runtime_checkable
class RelocatesNear(Protocol):
    """A reduced term that can make a cheaper copy, exact near a given state, such as a contact with
    a neighbour list."""

    def near(self, x: FloatArray) -> "LocalCopy": ...


@runtime_checkable
class TimeDependent(Protocol):
    """A term with the exact partial time derivative of its constraint equations.

    Optional: for constraints without it, the initial accelerations use finite differences in time.
    """

    def time_derivative(self, order: int, t: float, h: float) -> Term | None:
        """Partial derivative by time of order 1 or 2, from the right at t, s, as a term whose
        constraint rows are valid at t; None if it is zero. h: time step, s."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Affine trial basis of the unknowns at a term's columns: x = offset + atoms @ xi, v = atoms @
    xi', a = atoms @ xi''; atoms (n, k), offset (n,)."""

    atoms: FloatArray
    offset: FloatArray


class ReducedTerm(Protocol):
    """Projected residual term: l equations in k reduced unknowns, Jacobian (l, k).

    c1, c2 (k,): dv = c1 dx, da = c2 dx. elements: number of mesh elements per evaluation.
    """

    @property
    def elements(self) -> int: ...
    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray: ...


@runtime_checkable
class Linearizes(Protocol):
    """A reduced term that returns its residual (l,) and Jacobian (l, k) from one evaluation, equal
    to those of `residual` and `jacobian`."""

    def linearized(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> tuple[FloatArray, FloatArray]: ...


class LocalCopy(ReducedTerm, ChecksStep, Protocol):
    """Cheaper copy of a reduced term for states near `at` (k,), at which it was made."""

    @property
    def at(self) -> FloatArray: ...
    def holds(self, x: FloatArray) -> bool:
        """True if the copy is still exact at the reduced state x (k,)."""
        ...

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]: ...
