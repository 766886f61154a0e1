"""Training matrix G of ECSW, evaluated for a few elements at a time.

G has one row for each atom and each combination of snapshots, and one column for each element: 2 GB
for 40 atoms and 81 thousand tetrahedra. It is never stored as a whole. The weights follow from U^T
G with the few dominant eigenvectors U of G G^T; both are assembled blockwise.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array

from sparsemor.core import FloatArray, IntArray

BLOCK = 4_000_000
"""Largest number of entries of G that are computed at a time: 32 MB plus intermediate arrays."""
ROUND_OFF = 1e-11
"""Ratio of a sum of forces to its largest terms below which the sum is round-off."""
MOST = 4000
"""Largest number of equations for the weights; more equations are replaced by as many random
combinations."""
SIGNS = 8
"""Number of random combinations that each equation enters."""
Part: TypeAlias = slice | IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Some rows of G. make(elements) returns their columns (count, E') for a slice or numbers of
    elements.

    against: None for rows with final scaling; otherwise the rows are to be divided by the norm of
    their sum over all elements, or dropped where that norm is round-off relative to `against`.
    """

    count: int
    make: Callable[[Part], FloatArray]
    against: float | None = None
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Linear equations G w = G 1 for the weights w of `count` elements. content: the arrays that
    determine G, for the key of the cache."""

    count: int
    parts: tuple[Rows, ...]
    content: tuple[Any, ...]

    @classmethod
    def of(cls, G: FloatArray, against: float | None = None) -> "Equations":
        """Equations with an explicit matrix G (m, E); against: see `Rows`."""
        rows = (Rows(len(G), lambda part: np.asarray(G[:, part]), against),) if len(G) else ()
        return cls(G.shape[1], rows, (G, against))

    @property
    def rows(self) -> int:
        return sum(p.count for p in self.parts)

    def columns(self, part: Part) -> FloatArray:
        """Columns (m, E') of G for some elements."""
        return np.concatenate([p.scale * p.make(part) for p in self.parts])

    def _chunks(self, elements: IntArray) -> Iterator[tuple[slice, FloatArray]]:
        """Columns of G for some elements in chunks of at most `BLOCK` entries, each with its range
        in `elements`."""
        step = max(BLOCK // max(self.rows, 1), 1)
        for first in range(0, len(elements), step):
            part = slice(first, first + step)
            yield part, self.columns(elements[part])

    def applied(self, w: FloatArray) -> FloatArray:
        """Product G w (m,); elements of weight 0 are not visited."""
        used = np.flatnonzero(w)
        sums: FloatArray = np.zeros(self.rows)
        for part, G in self._chunks(used):
            sums += G @ w[used[part]]
        return sums

    def total(self) -> FloatArray:
        """Sum G 1 (m,) of the columns of all elements."""
        return self.applied(np.ones(self.count))

    def scaled(self) -> "Equations":
        """The equations with rows divided by the norm of their sums where `Rows.against` requires
        it; rows whose sums are round-off are dropped."""
        kept = []
        for p in self.parts:
            if p.against is None:
                kept.append(p)
                continue
            size = float(np.linalg.norm(replace(self, parts=(p,)).total()))
            if size > ROUND_OFF * p.against:
                kept.append(replace(p, against=None, scale=1.0 / size))
        return replace(self, parts=tuple(kept))

    def fewer(self) -> "Equations":
        """At most as many equations as weights, with the same |G w - G 1|, by a QR
        factorisation."""
        if self.rows <= 2 * self.count:
            return self
        return Equations.of(np.asarray(np.linalg.qr(self.columns(slice(None)), mode="r")))

    def mixed(self) -> "Equations":
        """At most `MOST` equations: random combinations of the rows that preserve |G x| up to a
        factor near 1 for x (E,) in subspaces of lower dimension (sparse sign embedding, Martinsson
        and Tropp 2020, doi 10.1017/S0962492920000021, Sec. 9.2). Weights found with them must be
        verified with all equations."""
        if self.rows <= MOST:
            return self
        rng = np.random.default_rng(0)
        stratum = MOST // SIGNS
        where = rng.integers(stratum, size=(self.rows, SIGNS)) + stratum * np.arange(SIGNS)
        signs = rng.choice([-1.0, 1.0], where.shape) / np.sqrt(SIGNS)
        S = csr_array((signs.ravel(), (where.ravel(), np.arange(self.rows).repeat(SIGNS))),
                      (MOST, self.rows))
        rows = Rows(MOST, lambda part: np.asarray(S @ self.columns(part)))
        return Equations(self.count, (rows,), ())

    def directions(
        self, elements: IntArray, total: FloatArray, floor: float
    ) -> tuple[FloatArray, FloatArray]:
        """Singular values above `floor` (r,), ascending, and left singular vectors (m, r) of the
        columns of some elements and of `total` (m,) side by side."""
        square = np.outer(total, total)
        for _, G in self._chunks(elements):
            square += G @ G.T
        squares, U = eigh(square, subset_by_value=(floor**2, np.inf), overwrite_a=True)
        return np.sqrt(squares), U

    def along(self, U: FloatArray, elements: IntArray) -> FloatArray:
        """Projected columns U^T G (r, E') of some elements, U (m, r)."""
        A: FloatArray = np.zeros((U.shape[1], len(elements)))
        for part, G in self._chunks(elements):
            A[:, part] = U.T @ G
        return A
