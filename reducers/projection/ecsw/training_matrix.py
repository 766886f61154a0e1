"""Training matrix G of ECSW, evaluated for a few elements at a time.

G has one row for each atom and each training state, or combination of such states, and one column
for each element: 1 GB for 30 atoms, 200 states and 20 thousand triangles. It is never stored as a
whole. Weights are found with fewer equations, random combinations of the rows of G, and verified
with all of them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy.sparse import csr_array

from sparsemor.core import FloatArray, IntArray

BLOCK = 4_000_000
"""Largest number of entries of G that are computed at a time: 32 MB plus intermediate arrays."""
ROUND_OFF = 1e-11
"""Ratio of a sum of forces to its largest terms below which the sum is round-off."""
SIGNS = 8
"""Number of random combinations that each equation enters."""
Part: TypeAlias = slice | IntArray


@dataclass(frozen=True, slots=True, eq=False)
class EquationRows:
    """`count` rows of the training matrix G (m, E), whose column e holds the projected forces of
    element e at the training states. make(elements) returns their columns (count, E') for a slice
    or numbers of elements; they are to be multiplied by `scale`.

    against: None for rows with final scaling; otherwise the rows are to be divided by the norm of
    their sum over all elements, or dropped where that norm is round-off relative to `against`.
    """

    count: int
    make: Callable[[Part], FloatArray]
    against: float | None = None
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class WeightEquations:
    """Linear equations G w = G 1 for the weights w of `count` elements. content: the arrays that
    determine G, for the key of the cache; sums (m,): G 1, and sizes (parts, E): norms of the
    columns of each part, where they have been computed."""

    count: int
    parts: tuple[EquationRows, ...]
    content: tuple[Any, ...]
    sums: FloatArray | None = None
    sizes: FloatArray | None = None

    @classmethod
    def from_matrix(cls, G: FloatArray, against: float | None = None) -> "WeightEquations":
        """Equations with an explicit matrix G (m, E); against: see `EquationRows`."""
        rows = EquationRows(len(G), lambda part: np.asarray(G[:, part]), against)
        return cls(G.shape[1], (rows,) if len(G) else (), (G, against))

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
        return self.applied(np.ones(self.count)) if self.sums is None else self.sums

    def _summed(self) -> tuple[FloatArray, FloatArray]:
        """Sum G 1 (m,), and norms (parts, E) of the columns of each part."""
        if self.sums is not None and self.sizes is not None:
            return self.sums, self.sizes
        sums, sizes = np.zeros(self.rows), np.zeros((len(self.parts), self.count))
        ends = np.cumsum([p.count for p in self.parts])[:-1]
        for part, G in self._chunks(np.arange(self.count)):
            sums += G @ np.ones(G.shape[1])
            sizes[:, part] = [np.linalg.norm(rows, axis=0) for rows in np.split(G, ends)]
        return sums, sizes

    def scaled(self) -> "WeightEquations":
        """The equations with rows divided by the norm of their sums where `EquationRows.against`
        requires it; rows whose sums are round-off are dropped."""
        total, sizes = self._summed()
        parts, sums, edge, numbers = [], [np.zeros(0)], 0, list[int]()
        for number, p in enumerate(self.parts):
            sums_of_part = total[edge : (edge := edge + p.count)]
            size = float(np.linalg.norm(sums_of_part))
            if p.against is None:
                parts.append(p)
                sums.append(sums_of_part)
            elif size > ROUND_OFF * p.against:
                parts.append(replace(p, against=None, scale=1.0 / size))
                sums.append(sums_of_part / size)
            else:
                continue
            numbers.append(number)
        return replace(self, parts=tuple(parts), sums=np.concatenate(sums), sizes=sizes[numbers])

    def shares(self) -> FloatArray:
        """Share (E,) of each element in the norms of all columns, the mean over the parts."""
        sizes = self._summed()[1]
        return np.asarray((sizes / sizes.sum(axis=1, keepdims=True)).mean(axis=0))

    def combined(self, elements: IntArray, most: int) -> "Combined":
        """The equations for the weights of some elements, or where these are more than `most`,
        `most` random combinations of them.

        The combinations (sparse sign embedding, Martinsson and Tropp 2020, doi
        10.1017/S0962492920000021, Sec. 9.2) preserve |G x| up to a factor near 1 for x in subspaces
        of a dimension far below `most`. Equations for few elements are replaced by their QR factor,
        with equal |G x|.
        """
        if self.rows * (len(elements) + 1) <= BLOCK:  # few enough entries to be held at once
            A, b = self.columns(elements), self.total()
            if len(A) > 2 * len(elements):  # |A w - b| = |R [w, -1]| with [A, b] = Q R
                R = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
                A, b = R[:, :-1], R[:, -1]
            return Combined(A, b, exact=True)
        # S (most, rows): random signs, None where all rows are taken
        S = None if self.rows <= most else _signs(self.rows, most)
        A = np.empty((self.rows if S is None else most, len(elements)))
        for part, G in self._chunks(elements):
            A[:, part] = G if S is None else S @ G
        total = self.total()
        return Combined(A, total if S is None else np.asarray(S @ total), exact=S is None)


class Combined(NamedTuple):
    """Equations A w = b for the weights w (E',) of some elements, A (s, E'); exact: |A w - b| is
    that of all equations."""

    A: FloatArray
    b: FloatArray
    exact: bool


def _signs(rows: int, most: int) -> csr_array:
    """Sparse random signs (most, rows), `SIGNS` for each row, the same in every call."""
    rng = np.random.default_rng(0)
    stratum = most // SIGNS
    # each row of G goes to one combination in each of SIGNS groups of combinations
    where = rng.integers(stratum, size=(rows, SIGNS)) + stratum * np.arange(SIGNS)
    signs = rng.choice([-1.0, 1.0], where.shape) / np.sqrt(SIGNS)
    return csr_array((signs.ravel(), (where.ravel(), np.arange(rows).repeat(SIGNS))),
                     (most, rows))
