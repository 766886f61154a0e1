"""Residual and Jacobian of the whole model as sums of residual terms, and terms with matrices that
are assembled once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Generic, Protocol, Self, TypeVar

import numpy as np
from scipy.sparse import csc_array, csr_array, issparse

from sparsemor.core.arrays import Csr, FloatArray, IntArray, Matrix
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.protocols.term import ReducedTerm, Term, Trial


def dense(matrix: Matrix) -> FloatArray:
    """Sparse or dense matrix as an array of all its entries."""
    return np.asarray(matrix.toarray() if issparse(matrix) else matrix, dtype=np.float64)


def sparse(matrix: FloatArray) -> Csr:
    """Array as a sparse matrix of its nonzero entries; for small ones in half the time of
    `csr_array(matrix)`."""
    rows, columns = np.nonzero(matrix)
    starts = np.searchsorted(rows, np.arange(len(matrix) + 1)).astype(np.int32)
    return csr_array((matrix[rows, columns], columns.astype(np.int32), starts), matrix.shape)


def system_residual(
    layout: Layout, terms: Sequence[Term], x: FloatArray, v: FloatArray, a: FloatArray, t: float
) -> FloatArray:
    """Residual (n,) of the whole model."""
    r = np.zeros(layout.size)
    for term in terms:
        j = term.columns
        np.add.at(r, term.rows, term.residual(x[j], v[j], a[j], t))
    return r


def system_jacobian(
    layout: Layout, terms: Sequence[Term], x: FloatArray, v: FloatArray, a: FloatArray, t: float,
    c1: FloatArray, c2: FloatArray,
) -> Csr:
    """Jacobian (n, n), csc, of the whole model, with dv = c1 dx and da = c2 dx; c1, c2 (n,)."""
    rows, columns = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
    values = [np.zeros(0)]
    # entries (i, j, J_ij) of all terms; those at one place are summed by csc_array
    for term in terms:
        j = term.columns
        if not len(j):  # a load that is a function of time
            continue
        J = csr_array(term.jacobian(x[j], v[j], a[j], t, c1[j], c2[j]))  # of any format
        # short numbers (int32): this is what takes most memory at the start of a large run
        rows.append(np.repeat(term.rows.astype(np.int32), np.diff(J.indptr)))
        columns.append(j.astype(np.int32)[J.indices])
        values.append(J.data)
    n = layout.size
    places = np.concatenate(rows), np.concatenate(columns)
    return csc_array((np.concatenate(values), places), shape=(n, n))


def rate_factors(
    layout: Layout, c1: float, c2: float, c1_first: float
) -> tuple[FloatArray, FloatArray]:
    """Factors c1, c2 (n,) of dv = c1 dx, da = c2 dx for each unknown; those of first-order unknowns
    are c1_first and 0, those of algebraic ones 0."""
    k1, k2 = np.zeros(layout.size), np.zeros(layout.size)
    k1[layout.second], k1[layout.first], k2[layout.second] = c1, c1_first, c2
    return k1, k2


class AssembledEquations(Protocol):
    """m equations r = 0 in n unknowns x without loops over elements; rates v, second derivatives a
    (n,); Jacobian dr/dx (m, n) with dv = c1 dx, da = c2 dx, factors (n,). linear: True for constant
    matrices."""

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
        """True: `time_derivative` is that of its constraint equations."""
        return True

    @property
    def linear(self) -> bool:
        return self.equations.linear

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.equations.residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> Csr:
        J = self.equations.jacobian(x, v, a, t, c1, c2)
        return csr_array(J) if issparse(J) else sparse(J)

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
