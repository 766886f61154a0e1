"""The equations that weights of elements are trained on, made a few elements at a time.

G has one row for each atom and each combination of snapshots, and one column for each element: 2 GB
for 40 atoms at 81 thousand tetrahedra. It is never held as a whole. Weights are found from U^T G
alone, with the few eigenvectors U of G G^T that matter; both are assembled block by block.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_array

from sparsemor.core import FloatArray, IntArray

BLOCK = 4_000_000
"""Entries of G that are computed at a time: 32 MB, and some more for intermediate arrays."""
ROUND_OFF = 1e-11
"""Forces this much smaller than the sums that they are made of are what is left of rounding."""
MOST = 4000
"""Equations that weights are sought with: of more, so many random combinations."""
SIGNS = 8
"""Combinations that each equation is a part of."""
Part: TypeAlias = slice | IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Some rows of G. make(elements) -> (count, E'): their columns of a slice or of numbers.

    against: None for rows that are scaled already; else they are to be taken as shares of their
    sum over all elements, and left out where that is round-off of sums of this size.
    """

    count: int
    make: Callable[[Part], FloatArray]
    against: float | None = None
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """G w = G 1 for the weights of `count` elements. content: what G is made of, to be digested."""

    count: int
    parts: tuple[Rows, ...]
    content: tuple[Any, ...]

    @classmethod
    def of(cls, G: FloatArray, against: float | None = None) -> "Equations":
        """Equations (m, E) that are there."""
        rows = (Rows(len(G), lambda part: np.asarray(G[:, part]), against),) if len(G) else ()
        return cls(G.shape[1], rows, (G, against))

    @property
    def rows(self) -> int:
        return sum(p.count for p in self.parts)

    def columns(self, part: Part) -> FloatArray:
        """(m, E'): those of some elements."""
        return np.concatenate([p.scale * p.make(part) for p in self.parts])

    def _chunks(self, elements: IntArray) -> Iterator[tuple[slice, FloatArray]]:
        """Columns of some elements, no more at a time than `BLOCK` allows, and which they are."""
        step = max(BLOCK // max(self.rows, 1), 1)
        for first in range(0, len(elements), step):
            part = slice(first, first + step)
            yield part, self.columns(elements[part])

    def applied(self, w: FloatArray) -> FloatArray:
        """(m,): G w; elements of weight 0 are not visited."""
        used = np.flatnonzero(w)
        sums: FloatArray = np.zeros(self.rows)
        for part, G in self._chunks(used):
            sums += G @ w[used[part]]
        return sums

    def total(self) -> FloatArray:
        """(m,): G 1."""
        return self.applied(np.ones(self.count))

    def scaled(self) -> "Equations":
        """The same with rows as shares of their sums, where they are to be; those left out whose
        sums are round-off."""
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
        """As many equations as there are weights at most, with the same |G w - G 1|."""
        if self.rows <= 2 * self.count:
            return self
        return Equations.of(np.asarray(np.linalg.qr(self.columns(slice(None)), mode="r")))

    def mixed(self) -> "Equations":
        """At most `MOST` equations: random combinations that keep |G x| for the x (E,) in spaces of
        fewer dimensions, to a factor near 1 (sparse signs, Martinsson and Tropp 2020, doi
        10.1017/S0962492920000021, Sec. 9.2). Weights found with them are to be checked with all."""
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
        """Singular values above `floor` (r,), ascending, and left vectors (m, r) of the columns of
        some elements and of `total` (m,) next to them."""
        square = np.outer(total, total)
        for _, G in self._chunks(elements):
            square += G @ G.T
        squares, U = eigh(square, subset_by_value=(floor**2, np.inf), overwrite_a=True)
        return np.sqrt(squares), U

    def along(self, U: FloatArray, elements: IntArray) -> FloatArray:
        """(r, E'): U^T G of some elements, U (m, r)."""
        A: FloatArray = np.zeros((U.shape[1], len(elements)))
        for part, G in self._chunks(elements):
            A[:, part] = U.T @ G
        return A
