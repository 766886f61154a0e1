"""Cached factorizations of submatrices of a Gram matrix."""

from typing import TypeVar

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray, Quadratic
from sparsemor.plugins.sparse_solvers.gram import Move, Normal, Part, Swap, gathered

T = TypeVar("T")
KEPT = 256
"""Number of cached index lists; supports and proposed supports often recur."""


class Factors:
    """Cholesky factors of submatrices of the latest Gram matrix, computed on first use.

    Index lists of columns are cached beyond a change of the matrix. longest: largest of the column
    lengths.
    """

    def __init__(self) -> None:
        self.longest = 0.0
        self._gram = np.zeros((0, 0))
        self._normal: dict[bytes, Normal | None] = {}
        self._moves: dict[bytes, Move | None] = {}
        self._parts: dict[bytes, Part] = {}
        self._swaps: dict[bytes, Swap] = {}

    def fitted(
        self, at: Quadratic, columns: BoolArray
    ) -> tuple[IntArray, FloatArray, float] | None:
        """Indices of the columns in the mask, the step s of least squares on them (coefficients c -
        s), and its rounding error; None for nearly dependent columns."""
        self._remember(at)
        key = columns.tobytes()
        if key not in self._parts:
            room(self._parts)[key] = Part.of(np.flatnonzero(columns), len(columns))
        part = self._parts[key]
        if key not in self._normal:
            self._normal[key] = (
                Normal.of(at.gram, False) if part.flat is None else
                Normal.of(gathered(at.gram, part.flat).T, True))
        normal = self._normal[key]
        if normal is None:
            return None
        step = normal.solve(at.slope if part.flat is None else at.slope.take(part.columns))
        return part.columns, step, normal.rounding(step)

    def inverse(self, at: Quadratic, columns: BoolArray) -> FloatArray | None:
        """Matrix (k, k) that maps a slope (half the gradient of the squared residual) to the step
        of `fitted`; None for nearly dependent columns."""
        if self.fitted(at, columns) is None:
            return None
        key, whole = columns.tobytes(), np.zeros((len(at.c), len(at.c)))
        normal, use = self._normal[key], self._parts[key].columns
        assert normal is not None
        whole[np.ix_(use, use)] = normal.inverted()
        return whole

    def move(self, at: Quadratic, support: BoolArray, kept: BoolArray) -> Move | None:
        """Exchange of the support for `kept`; None for nearly dependent columns."""
        self._remember(at)
        key = support.tobytes() + kept.tobytes()
        if key not in self._moves:
            if key not in self._swaps:
                room(self._swaps)[key] = Swap.of(support, kept)
            self._moves[key] = Move.of(at.gram, self._swaps[key])
        return self._moves[key]

    def _remember(self, at: Quadratic) -> None:
        if at.gram is not self._gram:
            self._gram, self.longest = at.gram, float(at.lengths.max())
            self._normal, self._moves = {}, {}


def room(kept: dict[bytes, T]) -> dict[bytes, T]:
    """The same dictionary, without its oldest entry when it is full."""
    if len(kept) >= KEPT:
        kept.pop(next(iter(kept)))
    return kept
