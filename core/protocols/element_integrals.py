"""Constant matrices as sums over mesh elements: what a reducer needs that weighs elements.

A body may offer them next to its assembled operators. They are asked for offline only; no step
meets an array of this size.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray
from sparsemor.core.protocols.term import Term


@dataclass(frozen=True, slots=True, eq=False)
class Integrals:
    """The element integrals of a matrix of `shape` (n, m), which is their sum.

    rows (E, p), columns (E, q): place of each element's entries in the matrix, -1 where its node
    has no unknown there; values (E, p, q).
    """

    rows: IntArray
    columns: IntArray
    values: FloatArray
    shape: tuple[int, int]

    @property
    def count(self) -> int:
        """Number of elements E."""
        return len(self.values)

    def part(self, elements: slice | IntArray) -> "Integrals":
        """Those of some elements: a slice, or numbers."""
        return Integrals(self.rows[elements], self.columns[elements], self.values[elements],
                         self.shape)

    def weighted(self, weights: FloatArray) -> Csr:
        """(n, m): sum of the integrals times weights (E,); elements of weight 0 are not visited."""
        used = np.flatnonzero(weights)
        values = weights[used, None, None] * self.values[used]
        i = np.broadcast_to(self.rows[used, :, None], values.shape)
        j = np.broadcast_to(self.columns[used, None, :], values.shape)
        here = (i >= 0) & (j >= 0)
        return csr_array((values[here], (i[here], j[here])), shape=self.shape)

    def projected(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """(E, k, r): left^T (integral) right of each element, left (n, k), right (m, r)."""
        return np.asarray(np.einsum(
            "epk,epr->ekr", _gathered(left, self.rows),
            self.values @ _gathered(right, self.columns), optimize=True))


def _gathered(matrix: FloatArray, at: IntArray) -> FloatArray:
    """(E, p, k): the rows of `matrix` that each element reads, zero where it has none."""
    return np.where(at[:, :, None] >= 0, matrix[at], 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ElasticIntegrals:
    """The internal force of an elastic block, element by element:

    stiffness u - coupling T - given [1; amplitudes(t)], where coupling is None without a thermal
    block and given (n, 1 + j) holds what known temperatures do. Inertia and damping are no part.
    """

    stiffness: Integrals
    coupling: Integrals | None
    given: Integrals
    amplitudes: tuple[Callable[[float], float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class HeatIntegrals:
    """The heat balance of a thermal block's elements: capacity T' + conductivity T - given
    [1; amplitudes(t)]. Films and loads on the surface are no part."""

    capacity: Integrals
    conductivity: Integrals
    given: Integrals
    amplitudes: tuple[Callable[[float], float], ...]




@runtime_checkable
class WeighsElements(Protocol):
    """A local term whose elements can be weighted, as ECSW needs.

    Laws: `contributions(left, x, v, t).sum(axis=0)` is `left @ residual` at each state;
    `weighted(w)` visits the elements with w != 0 alone, and its residual at its own rows is the sum
    of the elements' residuals times w.
    """

    def contributions(
        self, left: FloatArray, x: FloatArray, v: FloatArray, t: FloatArray
    ) -> FloatArray:
        """(F, l, M): left (l, m) times what each element adds at states x (n, M) with rates v
        (n, M), t (M,) s."""
        ...

    def weighted(self, weights: FloatArray) -> Term:
        """The term with weights (F,) >= 0, rows and columns those of the elements kept."""
        ...
