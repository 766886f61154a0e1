"""Element integrals of constant matrices, for hyper-reduction that weights elements.

A body may offer them in addition to its assembled matrices. They are used offline only; no time
step handles arrays of this size.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core.arrays import Csr, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Integrals:
    """Element integrals of a matrix of `shape` (n, m), which is their sum over the elements.

    rows (E, p), columns (E, q): matrix rows and columns of each element's entries, -1 for a node
    without an unknown; values (E, p, q).
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
        """Integrals of a subset of the elements, given by a slice or by numbers."""
        return Integrals(self.rows[elements], self.columns[elements], self.values[elements],
                         self.shape)

    def weighted(self, weights: FloatArray) -> Csr:
        """Weighted matrix (n, m): sum over elements of weights (E,) times integral; elements of
        weight 0 are not visited."""
        used = np.flatnonzero(weights)
        values = weights[used, None, None] * self.values[used]
        i = np.broadcast_to(self.rows[used, :, None], values.shape)
        j = np.broadcast_to(self.columns[used, None, :], values.shape)
        here = (i >= 0) & (j >= 0)
        return csr_array((values[here], (i[here], j[here])), shape=self.shape)

    def projected(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Projected element matrices left^T (integral) right, (E, k, r), with left (n, k), right
        (m, r)."""
        return np.asarray(np.einsum(
            "epk,epr->ekr", _gathered(left, self.rows),
            self.values @ _gathered(right, self.columns), optimize=True))


def _gathered(matrix: FloatArray, at: IntArray) -> FloatArray:
    """Rows of `matrix` at the unknowns of each element, (E, p, k); zero for a node without an
    unknown."""
    return np.where(at[:, :, None] >= 0, matrix[at], 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ElasticIntegrals:
    """Internal elastic force by elements: stiffness u - coupling T - given [1; amplitudes(t)].

    coupling: None without temperature unknowns; given (n, 1 + j): effect of prescribed
    temperatures. Inertia and damping are not included.
    """

    stiffness: Integrals
    coupling: Integrals | None
    given: Integrals
    amplitudes: tuple[Callable[[float], float], ...]


@dataclass(frozen=True, slots=True, eq=False)
class HeatIntegrals:
    """Heat balance by elements: capacity T' + conductivity T - given [1; amplitudes(t)]. Surface
    convection and surface loads are not included."""

    capacity: Integrals
    conductivity: Integrals
    given: Integrals
    amplitudes: tuple[Callable[[float], float], ...]
