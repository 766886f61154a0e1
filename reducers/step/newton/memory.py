"""State between steps of Newton's method with a reused Jacobian."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import Protocol, Self, TypeAlias

import numpy as np

from sparsemor.core import Csr, FloatArray, FrameWork, IntArray, LocalCopy
from sparsemor.reducers.step.memory import RunMemory
from sparsemor.reducers.step.predictor import Past

Matrix: TypeAlias = FloatArray | Csr


class Factor(Protocol):
    """A factorized Jacobian."""

    def solve(self, r: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """State at which a Jacobian was evaluated; c: c1, c2, and c1 of first-order unknowns."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    t: float
    c: tuple[float, float, float]


@dataclass(eq=False, kw_only=True)
class NewtonMemory(RunMemory):
    """State between steps of Newton's method for whole steps.

    point: state at which the kept Jacobian was evaluated; it is recomputed there after a restart,
    so that a resumed run repeats every digit. magnitudes: |J| of it. top (blocks,): largest value
    of each block so far; order: order of the extrapolation with the least error in the last step.
    near: number of a term -> its local copy (relocalised.py), stored as the state at which it was
    made; searches: number of such copies so far. work: working arrays of the bodies' frames,
    allocated by `buffers`.
    """

    top: FloatArray
    order: int = 1
    point: Linearisation | None = None
    factor: Factor | None = None
    magnitudes: Matrix | None = None
    near: dict[int, LocalCopy | FloatArray] = field(default_factory=dict)
    searches: int = 0
    buffers: Callable[[], Sequence[FrameWork]] = tuple
    work: Sequence[FrameWork] = ()

    @classmethod
    def of(
        cls, x: FloatArray, points: int, starts: Sequence[int] | IntArray,
        buffers: Callable[[], Sequence[FrameWork]] = tuple,
    ) -> Self:
        """Memory at a state x (n,) with blocks that begin at `starts`; points: number of past
        states to extrapolate."""
        return cls(past=Past(points, x, starts), top=np.zeros(len(starts)), buffers=buffers,
                   work=buffers())

    def __getstate__(self) -> dict[str, object]:
        state = {**vars(self), "factor": None, "magnitudes": None,
                 "near": {i: state_of(kept) for i, kept in self.near.items()},
                 "point": self.point and astuple(self.point)}
        del state["buffers"], state["work"]
        return state

    def __setstate__(self, state: dict[str, object]) -> None:
        point = state["point"]
        vars(self).update(
            state, point=Linearisation(*point) if isinstance(point, tuple) else None)

    def copy(self) -> Self:
        """Independent copy; the factorization and the local copies of terms are immutable and
        shared."""
        return replace(super().copy(), top=self.top.copy(), near=dict(self.near),
                       work=self.buffers())

    def at_newest(self) -> "NewtonMemory":
        """Independent memory with the same local copies of terms, for an evaluation at the last
        state."""
        other = NewtonMemory.of(self.newest, 1, self.past.starts)
        other.near = dict(self.near)
        return other

    def moved(self, x: FloatArray) -> None:
        super().moved(x)
        self.order = 1

    def counters(self) -> Mapping[str, int]:
        return {"factorizations": self.factorizations, "support_changes": self.support_changes,
                "searches": self.searches}


def state_of(kept: LocalCopy | FloatArray) -> FloatArray:
    """State (k,) at which a local copy of a term was made; in a stored memory the entry is that
    state."""
    return kept if isinstance(kept, np.ndarray) else kept.at
