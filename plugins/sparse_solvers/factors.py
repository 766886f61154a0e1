"""Factors of one Gram matrix, made when they are first asked for."""

from typing import TypeVar

import numpy as np

from sparsemor.core import BoolArray, FloatArray, IntArray, Quadratic
from sparsemor.plugins.sparse_solvers.gram import Move, Normal, Part, Swap, gathered

T = TypeVar("T")
KEPT = 256
"""Lists of positions kept at once; a support or a proposal often comes back."""


class Factors:
    """Of the last Gram matrix that was asked about; where columns lie in it is kept longer.

    longest: largest of the lengths that come with it."""

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
        """Numbers of these columns, what least squares on them takes off c, and its rounding;
        None for columns that are nearly dependent."""
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
        """(k, k) that takes a slope to what least squares on these columns takes off c; None for
        columns that are nearly dependent."""
        if self.fitted(at, columns) is None:
            return None
        key, whole = columns.tobytes(), np.zeros((len(at.c), len(at.c)))
        normal, use = self._normal[key], self._parts[key].columns
        assert normal is not None
        whole[np.ix_(use, use)] = normal.inverted()
        return whole

    def move(self, at: Quadratic, support: BoolArray, kept: BoolArray) -> Move | None:
        """From the support to `kept`; None for columns that are nearly dependent."""
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
    """The same dictionary, the oldest entry dropped when it is full."""
    if len(kept) >= KEPT:
        kept.pop(next(iter(kept)))
    return kept
