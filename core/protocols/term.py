"""Residual terms of the equations, and their projections on reduced bases."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from sparsemor.core.arrays import Csr, FloatArray, IntArray


class ResidualTerm(ABC):
    """An additive contribution to the residual of a full or reduced model.

    x, v, a: the unknowns that it reads, their rates and second derivatives; t in s. source: name of
    the joint, contact, load or body that contributes it.
    """

    __slots__ = ()

    @property
    def source(self) -> str:
        return ""

    @property
    def elements(self) -> int:
        """Number of mesh elements that one evaluation visits (0 for constant matrices)."""
        return 0

    @abstractmethod
    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray: ...

    @property
    def rejects(self) -> bool:
        """True if `check_step` may reject a step although its iteration converged."""
        return False

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        """Reason to reject a time step of about h, s, that ends at t, s; "" to accept it. x, v
        (n,): unknowns and rates at the term's columns."""
        return ""

    @property
    def histories(self) -> tuple[str, ...]:
        """Names of its force resultants or similar totals (power, contact area)."""
        return ()

    @property
    def hides_resultants(self) -> bool:
        """True if it omits elements on which its resultants depend, which are then unknown."""
        return False

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]:
        """Resultants by name at t, s; x, v (n,): unknowns and rates at the term's columns."""
        return {}


class Term(ResidualTerm):
    """One additive contribution to the residual of the model, with the rows that it adds to and the
    columns (stencil) that it reads.

    rows (m,), columns (n,): positions in the state vector. x, v, a (n,): unknowns, rates and second
    derivatives at `columns`; t in s. source: name of the joint, contact, load or body that
    contributes it, a dataclass field that the assembly sets. Laws, tested for every term:

    * `restrict(keep).residual(...) == residual(...)[keep]`, likewise the Jacobian, where the
      restricted term may have a smaller stencil;
    * `compress(trial, left).residual(xi, ...) == left @ residual(offset + atoms xi, ...)`.
    """

    __slots__ = ()
    rows: IntArray
    columns: IntArray

    @abstractmethod
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        """Derivative (m, n) of the residual by x, with dv = c1 dx and da = c2 dx; c1, c2 (n,)."""

    @abstractmethod
    def restrict(self, keep: IntArray) -> "Term":
        """The term with only the rows at positions `keep` of `rows`."""

    @abstractmethod
    def compress(self, trial: "Trial", left: FloatArray) -> "ReducedTerm":
        """Projected term left @ residual(offset + atoms xi), with test basis left (l, m), as a
        function of reduced unknowns xi."""

    @property
    def linear(self) -> bool:
        """True if the residual is K x + C v + M a - f(t) with constant matrices, which are then
        assembled once."""
        return False

    @property
    def damps(self) -> bool:
        """True if the residual is C v with a constant symmetric C that is not sparse: it is part of
        the damping of its block, and reduced models contain its projection."""
        return False

    @property
    def exact_in_time(self) -> bool:
        """True if `time_derivative` is that of its constraint equations; otherwise the initial
        accelerations use finite differences in time."""
        return False

    def time_derivative(self, order: int, t: float, h: float) -> "Term | None":
        """Partial derivative by time of order 1 or 2, from the right at t, s, as a term whose
        constraint rows are valid at t; None if it is zero. h: time step, s."""
        return None

    @property
    def point_values(self) -> int:
        """Largest number of values per atom of a projection that holds variables and test functions
        at quadrature points; 0 for a term whose projection does not."""
        return 0

    @property
    def weighs_elements(self) -> bool:
        """True if it is evaluated element by element with weights, as in ECSW (energy-conserving
        sampling and weighting), by `contributions` and `weighted`."""
        return False

    def contributions(
        self, left: FloatArray, x: FloatArray, v: FloatArray, t: FloatArray,
        elements: IntArray | None = None,
    ) -> FloatArray:
        """Projected residual of each element, or of those with the given numbers, (F, l, M): left
        (l, m) times its residual at states x, rates v (n, M) and times t (M,), s. Its sum over
        elements is left @ residual."""
        raise NotImplementedError

    def weighted(self, weights: FloatArray) -> "Term":
        """Term with element weights (F,) >= 0; its rows and columns are those of the elements with
        nonzero weight, which alone are visited."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Affine trial basis of the unknowns at a term's columns: x = offset + atoms @ xi, v = atoms @
    xi', a = atoms @ xi''; atoms (n, k), offset (n,)."""

    atoms: FloatArray
    offset: FloatArray


class ReducedTerm(ResidualTerm):
    """Projected residual term: l equations in k reduced unknowns, Jacobian (l, k).

    c1, c2 (k,): dv = c1 dx, da = c2 dx. What it inherits is that of the term that it projects.
    """

    __slots__ = ()

    @abstractmethod
    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray: ...

    def linearized(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Residual (l,) and Jacobian (l, k), by one evaluation where that is cheaper."""
        return self.residual(x, v, a, t), self.jacobian(x, v, a, t, c1, c2)

    def arrays(self) -> "PointArrays | None":
        """The term as arrays for compiled steps, None where it or its law has none."""
        return None

    @property
    def relocates(self) -> bool:
        """True if `near` makes a cheaper copy for states near one, such as a contact with a
        neighbour list."""
        return False

    def near(self, x: FloatArray) -> "LocalCopy":
        """Copy of the term for reduced states near x (k,), of a term that `relocates`."""
        raise NotImplementedError


class DelegatingTerm(ReducedTerm):
    """Reduced term with the source, elements, names of resultants and rejections of `term`, the
    term that it projects or another projection of it."""

    __slots__ = ()
    term: ResidualTerm

    @property
    def source(self) -> str:
        return self.term.source

    @property
    def elements(self) -> int:
        return self.term.elements

    @property
    def rejects(self) -> bool:
        return self.term.rejects

    @property
    def hides_resultants(self) -> bool:
        return self.term.hides_resultants

    @property
    def histories(self) -> tuple[str, ...]:
        return self.term.histories


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
    (i, j) of the derivatives dy_i/dz_j of its values y by its variables z, in the order in which
    `function` writes them (`LawFunction`), which uses numbers and arrays only, so that numba can
    compile it; calls: the functions that it calls, each after those that it calls itself; step:
    size of the steps over which it reads second differences, s, 0 if none.
    """

    numbers: FloatArray
    amplitudes: tuple[Callable[[float], float], ...]
    pairs: IntArray
    function: LawFunction
    calls: tuple[Callable[..., object], ...] = ()
    step: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PointArrays:
    """Projected term L y(P xi + o(t)) of a law y at E elements of Q points, xi (k,): reduced
    unknowns.

    weights (E, Q); coordinates (d, E Q), m; P (p, k), offset (p,): variables one after the other;
    effects (p, f): columns times functions of time `values`, with derivatives `rates` and second
    differences `bends` (`StepFormula`), that add to o. reads (c, 3): of each variable of the law
    its first row in P, its number of values per element, Q, or 1 if constant there, and 0 for its
    value, 1 for its rate or 2 for its second difference. tests: L (l, E Q) for each y, with the
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


class LocalCopy(ReducedTerm):
    """Cheaper copy of a reduced term for states near `at` (k,), at which it was made."""

    __slots__ = ()
    at: FloatArray

    @abstractmethod
    def holds(self, x: FloatArray) -> bool:
        """True if the copy is still exact at the reduced state x (k,)."""
