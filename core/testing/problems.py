"""Sparse problems with known answers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.core.protocols import Group, SparseStart


@dataclass(frozen=True, slots=True, eq=False)
class LeastSquares:
    """residual(c) = A c - b + bend * (B c)^2: linear for bend = 0. `answer` is known to solve it.

    A, B (m, k); answer (k,), sparse in every budgeted group.
    """

    groups: tuple[Group, ...]
    A: FloatArray
    B: FloatArray
    bend: float
    answer: FloatArray

    def residual(self, c: FloatArray) -> FloatArray:
        return np.asarray(self._left(c) - self._left(self.answer))

    def jacobian(self, c: FloatArray) -> FloatArray:
        return np.asarray(self.A + 2.0 * self.bend * (self.B @ c)[:, None] * self.B)

    def _left(self, c: FloatArray) -> FloatArray:
        return np.asarray(self.A @ c + self.bend * (self.B @ c) ** 2)

    @property
    def support(self) -> BoolArray:
        """(k,) where the answer is not zero, and all of the unpenalised groups."""
        mask = np.asarray(self.answer != 0.0)
        for g in self.groups:
            if g.budget is None:
                mask[g.start : g.stop] = True
        return mask


@dataclass(frozen=True, slots=True, eq=False)
class Elsewhere:
    """Another problem's residual, replaced by what `change` makes of it."""

    inner: LeastSquares
    change: Callable[[FloatArray], FloatArray]

    @property
    def groups(self) -> tuple[Group, ...]:
        return self.inner.groups

    def residual(self, c: FloatArray) -> FloatArray:
        return self.change(self.inner.residual(c))

    def jacobian(self, c: FloatArray) -> FloatArray:
        return self.inner.jacobian(c)


def incoherent(rng: np.random.Generator, bend: float = 0.0) -> LeastSquares:
    """Two groups of Gaussian columns, 3 of 40 and 2 of 30 active, and 4 free columns; 60 rows.

    Columns differ in length by up to 100, as those of rows in N and in W do.
    """
    free, first, second, m = 4, 40, 30, 60
    k = free + first + second
    groups = (
        Group("free", 0, free, None),
        Group("first", free, free + first, 3),
        Group("second", free + first, k, 2),
    )
    lengths = 10.0 ** rng.uniform(-1.0, 1.0, k)
    A = rng.standard_normal((m, k)) / np.sqrt(m) * lengths
    answer = np.zeros(k)
    answer[:free] = rng.standard_normal(free)
    for g in groups[1:]:
        chosen = rng.choice(np.arange(g.start, g.stop), g.budget, replace=False)
        answer[chosen] = rng.choice([-1.0, 1.0], g.budget or 0) * rng.uniform(1.0, 2.0, g.budget)
    answer /= lengths
    return LeastSquares(groups, A, rng.standard_normal((m, k)) * lengths / np.sqrt(m), bend, answer)


def coherent(rng: np.random.Generator, k: int = 60, m: int = 40, active: int = 4) -> LeastSquares:
    """One group of smooth columns, neighbours nearly parallel: recovery is not guaranteed."""
    x, centres = np.linspace(0.0, 1.0, m)[:, None], np.linspace(0.0, 1.0, k)
    A = np.exp(-(((x - centres) / 0.06) ** 2))
    answer = np.zeros(k)
    answer[rng.choice(k, active, replace=False)] = rng.uniform(1.0, 2.0, active)
    return LeastSquares((Group("only", 0, k, active),), A, np.zeros((m, k)), 0.0, answer)


def empty_start(k: int) -> SparseStart:
    return SparseStart(np.zeros(k), np.zeros(k, dtype=np.bool_))
