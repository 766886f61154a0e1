"""Step memory of Newton's method with a factor of the Jacobian that is kept."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import Protocol, Self, TypeAlias

import numpy as np

from sparsemor.core import Csr, FloatArray, FrameWork, LocalCopy
from sparsemor.reducers.step.memory import RunMemory
from sparsemor.reducers.step.predictor import Ring

Matrix: TypeAlias = FloatArray | Csr


class Factor(Protocol):
    """A factorized Jacobian."""

    def solve(self, r: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """Point at which a Jacobian was evaluated; c: c1, c2, c1 of first order."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    t: float
    c: tuple[float, float, float]


@dataclass(eq=False, kw_only=True)
class NewtonMemory(RunMemory):
    """Memory of one run.

    point: where the kept factor was made; after a restart it is made there again, so that a
    resumed run repeats every digit. magnitudes: |J| of it. top (blocks,): largest value of each
    block so far; order: of the extrapolation that predicted the last step best. near: number of a
    term -> its copy for states near one (relocalised.py), stored as that state; searches: how many
    were made. work: arrays that the bodies' frames fill, made by `buffers`.
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
        cls, x: FloatArray, points: int, blocks: int,
        buffers: Callable[[], Sequence[FrameWork]] = tuple,
    ) -> Self:
        """At a state x (n,) of so many blocks. points: of the extrapolation."""
        return cls(ring=Ring(points, x), top=np.zeros(blocks), buffers=buffers, work=buffers())

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
        """The factor and the terms' copies do not change and are shared."""
        return replace(super().copy(), top=self.top.copy(), near=dict(self.near),
                       work=self.buffers())

    def at_newest(self) -> "NewtonMemory":
        """Separate memory with the same copies of terms, for an evaluation at the last state."""
        other = NewtonMemory.of(self.newest, 1, len(self.top))
        other.near = dict(self.near)
        return other

    def moved(self, x: FloatArray) -> None:
        super().moved(x)
        self.order = 1

    def counters(self) -> Mapping[str, int]:
        return {"factorizations": self.factorizations, "support_changes": self.support_changes,
                "searches": self.searches}


def state_of(kept: LocalCopy | FloatArray) -> FloatArray:
    """(k,) the state that a copy of a term was made at; that itself in memory that was stored."""
    return kept if isinstance(kept, np.ndarray) else kept.at
