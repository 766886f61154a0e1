"""Why a support stays as long as the Gram matrix is the same: functions of slope and c, and
what steps that follow each other most often refuse alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from sparsemor.core import BoolArray, FloatArray, Quadratic
from sparsemor.plugins.sparse_solvers.candidates import Others
from sparsemor.plugins.sparse_solvers.gram import Move
from sparsemor.plugins.sparse_solvers.hard_thresholding import Largest, Tolerance

KEPT = 4
"""Reasons kept at once: where two proposals are close to each other, they come in turn."""


@dataclass(frozen=True, slots=True, eq=False)
class OfAll:
    """All columns take part: values (k,) are sizes of their least squares; order: the support's
    are the largest."""

    slope: FloatArray
    c: FloatArray
    order: Largest

    @classmethod
    def of(cls, inverse: FloatArray, lengths: FloatArray, order: Largest) -> "OfAll":
        return cls(-lengths[:, None] * inverse, np.diag(lengths), order)

    @property
    def parts(self) -> tuple[slice, ...]:
        return (slice(0, len(self.c)),)

    def holds(self, values: FloatArray, relative: float, absolute: Sequence[float]) -> bool:
        return self.order.holds(np.abs(values), Tolerance(relative, absolute[0]))


@dataclass(frozen=True, slots=True, eq=False)
class OfJoined:
    """Those take part that correlate most with what the support leaves: values are these
    correlations of all columns outside the support, then sizes of least squares on all columns. On
    fewer columns they are less by what makes the others vanish: some of the inverse's columns."""

    slope: FloatArray
    c: FloatArray
    order: Largest
    others: Others
    edges: list[slice]
    inverse: FloatArray

    @classmethod
    def of(
        cls, gram: FloatArray, own: FloatArray, inverse: FloatArray, lengths: FloatArray,
        order: Largest, others: Others,
    ) -> "OfJoined":
        """gram, own (inverse on the support), inverse (k, k), all in whole."""
        outside, k = np.concatenate(others.columns), len(lengths)
        left = ((np.eye(k) - gram @ own) / lengths[:, None])[outside]
        ends = np.cumsum([0, *map(len, others.columns)]).tolist()
        weights = lengths[:, None]
        return cls(
            np.vstack([left, -weights * inverse]),
            np.vstack([np.zeros_like(left), np.diag(lengths)]), order, others,
            [slice(i, j) for i, j in zip(ends, ends[1:], strict=False)],
            weights * inverse * lengths)

    @property
    def parts(self) -> tuple[slice, ...]:
        end = self.edges[-1].stop
        return slice(0, end), slice(end, len(self.slope))

    def holds(self, values: FloatArray, relative: float, absolute: Sequence[float]) -> bool:
        size = np.abs(values)
        found = self.others.left_out([size[e] for e in self.edges],
                                     Tolerance(relative, absolute[0]))
        if found is None:
            return False
        z = values[self.edges[-1].stop :]
        if found:
            out = np.concatenate(found)
            columns = self.inverse.take(out, axis=1)
            share, singular = lapack.dposv(columns.take(out, axis=0), z.take(out))[1:]
            if singular:
                return False
            z = z - columns.dot(share)
            z[out] = 0.0
        return self.order.holds(np.abs(z), Tolerance(relative, absolute[1]))


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
