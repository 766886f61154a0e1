"""Certificates that a support stays while the Gram matrix is the same: linear functions of slope
(half the gradient) and coefficients, and the latest rejected exchanges."""

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
"""Number of rejected exchanges kept: where two proposed supports are close, they alternate."""


@dataclass(frozen=True, slots=True, eq=False)
class OfAll:
    """Certificate of a support if all columns are candidates.

    Values (k,), slope @ (slope of the problem) + c @ (its coefficients), are the least-squares
    solution on all columns; order: test that the support's entries are the largest.
    """

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
    """Certificate of a support if the candidates are the columns most correlated with its residual.

    Values: correlations of all columns outside the support, followed by the least-squares solution
    on all columns. The solution on fewer columns follows by subtracting the columns of the inverse
    Gram matrix that make the other entries vanish.
    """

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
        """Certificate from the Gram matrix, its inverse on the support (`own`) and on all columns,
        each (k, k) with both triangles."""
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
    """Rejected exchange of a support for `kept`, the columns that `order` tests to be the largest.

    Either `kept` is the support itself (move None), or least squares on it fits no better.
    """

    kept: BoolArray
    order: Largest
    move: Move | None


class Refusals:
    """Latest rejected exchanges of one support and Gram matrix, the most recent first."""

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
        """Moves a rejected exchange that recurred to the front."""
        if why is not self.kept[0]:
            self.kept = [why, *(k for k in self.kept if k is not why)]
