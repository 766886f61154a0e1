"""Terms of the equations, whole and reduced."""

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

    Optional: `linear = True` where the residual is K x + C v + M a - f(t) with constant matrices:
    they are then assembled once; `doubt(x, v, t, h)`, which says why the end of a step of about h
    (s) is not to be trusted although it converged, "" if it is.
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
