"""Why a support stays where all columns may enter: what most steps repeat that follow with the same
Gram matrix."""

from typing import NamedTuple

from sparsemor.core import BoolArray, Quadratic
from sparsemor.plugins.sparse_solvers.gram import Move
from sparsemor.plugins.sparse_solvers.hard_thresholding import Largest

KEPT = 4
"""Reasons kept at once: where two proposals are close to each other, they come in turn."""


class Refusal(NamedTuple):
    """The columns that are largest (order) in the least squares on all of them are the support's
    own (move None), or fit no better: `kept`."""

    kept: BoolArray
    order: Largest
    move: Move | None


class Refusals:
    """The last ones of one support and Gram matrix, the latest first."""

    def __init__(self) -> None:
        self._at: Quadratic | None = None
        self._support: BoolArray | None = None
        self.kept: list[Refusal] = []

    def of(self, at: Quadratic, support: BoolArray) -> list[Refusal]:
        same = self._at is not None and at.gram is self._at.gram and support is self._support
        return self.kept if same else []

    def remember(self, at: Quadratic, support: BoolArray, why: Refusal) -> None:
        if not self.of(at, support):
            self._at, self._support, self.kept = at, support, []
        self.kept = [why, *self.kept[: KEPT - 1]]

    def first(self, why: Refusal) -> None:
        """It was met again."""
        if why is not self.kept[0]:
            self.kept = [why, *(k for k in self.kept if k is not why)]
