"""Step memory of Newton's method with a factor of the Jacobian that is kept."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np

from sparsemor.core import BoolArray, FloatArray, FrameWork
from sparsemor.reducers.step.predictor import Ring


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Point of linearisation of a Jacobian; c: c1, c2, c1 of first order."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    t: float
    c: tuple[float, float, float]


class NewtonMemory:
    """Memory of one run; its state is plain data (core/results/saved_state.py).

    place: where the kept factor was made: after a restart it is made there again, so that a
    resumed run repeats every digit. top (blocks,): largest value of each block so far; order: of
    the extrapolation that predicted the last step best. near: number of a term -> its copy for
    states near one (following.py), stored as that state; searches: how many were made.
    buffers: makes `work`, the arrays that the bodies' frames fill.
    """

    def __init__(
        self, x: FloatArray, points: int, blocks: int,
        buffers: Callable[[], Sequence[FrameWork]] = tuple,
    ) -> None:
        self.buffers, self.work = buffers, buffers()
        self.ring, self.order = Ring(points, x), 1
        self.top = np.zeros(blocks)
        self.place: Place | None = None
        self.factor: Any = None
        self.size: Any = None
        self.factorizations, self.support_changes = 0, 0
        self.near: dict[int, Any] = {}
        self.searches = 0
        self.supports: dict[str, BoolArray] = {}

    def __getstate__(self) -> dict[str, Any]:
        near = {i: kept if isinstance(kept, np.ndarray) else kept.at
                for i, kept in self.near.items()}
        place = self.place and tuple(getattr(self.place, f.name) for f in fields(self.place))
        state = {**self.__dict__, "factor": None, "size": None, "near": near, "place": place}
        del state["buffers"], state["work"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        place = state["place"]
        self.__dict__.update(state, place=place and Place(*place))

    def copy(self) -> Self:
        """Separate memory of the same state, with working arrays of its own; the factor and the
        terms' copies do not change and are shared."""
        other = self.__class__.__new__(self.__class__)
        other.__dict__.update(
            self.__dict__, ring=self.ring.copy(), top=self.top.copy(), near=dict(self.near),
            supports=dict(self.supports), work=self.buffers())
        return other

    def beside(self) -> "NewtonMemory":
        """Another one with the same copies of terms, for a look at the last state."""
        other = NewtonMemory(self.ring.rows[self.ring.newest], 1, len(self.top))
        other.near = dict(self.near)
        return other

    def moved(self, x: FloatArray) -> None:
        """The next step starts at x, after steps of another size that another solver took."""
        self.ring.push(x)
        self.ring.restart()
        self.order = 1

    def counters(self) -> Mapping[str, int]:
        return {"factorizations": self.factorizations, "support_changes": self.support_changes,
                "searches": self.searches}
