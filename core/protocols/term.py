"""Residual terms of the equations, and their projections on reduced bases."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np

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


LawFunction: TypeAlias = Callable[
    [FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray], None]
"""A pointwise law on arrays:

    function(numbers, gains, z, x, y, slopes)

with the numbers of the law (j,), the present values `gains` of its amplitudes, the variables z (c,
N) and coordinates x (d, N) at N points. It fills y (m, N) and slopes (derivatives, N), which has no
rows where no derivatives are wanted.
"""


@dataclass(frozen=True, slots=True, eq=False)
class LawArrays:
    """A pointwise law as a function of numbers.

    numbers (j,): constants; amplitudes: functions of time that it depends on; pairs (q, 2): numbers
    (i, j) of the derivatives dy_i/dz_j in the order of `slopes`; function: uses numbers and arrays
    only, so that numba can compile it; calls: the functions that it calls, each after those that it
    calls itself.
    """

    numbers: FloatArray
    amplitudes: tuple[Callable[[float], float], ...]
    pairs: IntArray
    function: LawFunction
    calls: tuple[Callable[..., object], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class PointArrays:
    """Projected term L y(P xi + o(t)) of a law at E elements of Q points.

    weights (E, Q); coordinates (d, E Q), m; P (p, k), offset (p,): variables one after the other;
    effects (p, f): columns times functions of time `values`, with derivatives `rates` and second
    differences `bends` (`StepFormula`), that add to o. reads (c, 3): of each variable of the law
    its first row in P, its number of values per element, Q, or 1 if constant there, and 1 for its
    rate or 2 for its second difference. tests: L (l, E Q) for each y, with the
    weights, or (l, E) without.
    """

    law: LawArrays
    weights: FloatArray
    coordinates: FloatArray
    P: FloatArray
    offset: FloatArray
    effects: FloatArray
    values: tuple[Callable[[float], float], ...]
    rates: tuple[Callable[[float], float], ...]
    bends: tuple[Callable[[float], float], ...]
    reads: IntArray
    tests: tuple[FloatArray, ...]

    def through(self, left: FloatArray) -> "PointArrays":
        """The term with its rows multiplied by left (s, l)."""
        return replace(self, tests=tuple(left @ L for L in self.tests))

    def placed(self, at: slice, size: int) -> "PointArrays":
        """The term as one of `size` unknowns, of which it reads those numbered `at`."""
        P = np.zeros((len(self.P), size))
        P[:, at] = self.P
        return replace(self, P=P)


@runtime_checkable
class HasPointArrays(Protocol):
    """A projected term that is also given as arrays; steps of models with other terms that depend
    on the unknowns are not compiled."""

    def arrays(self) -> PointArrays | None:
        """The arrays, None where its law has none."""
        ...


class LocalCopy(ReducedTerm, ChecksStep, Protocol):
    """Cheaper copy of a reduced term for states near `at` (k,), at which it was made."""

    @property
    def at(self) -> FloatArray: ...
    def holds(self, x: FloatArray) -> bool:
        """True if the copy is still exact at the reduced state x (k,)."""
        ...

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]: ...
