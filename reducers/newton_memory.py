"""What an iteration with a kept factor carries from step to step."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray
from sparsemor.reducers.predictor import Ring


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where a Jacobian is taken; c: c1, c2, c1 of first order."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    t: float
    c: tuple[float, float, float]


class NewtonMemory:
    """What a run carries from step to step; its state is plain data (core/saved.py).

    place: where the kept factor was made: after a restart it is made there again, so that a
    resumed run repeats every digit. top (blocks,): largest value of each block so far; order: of
    the extrapolation that foretold the last step best. near: number of a term -> its copy for
    states near one (following.py), stored as that state; searches: how many were made.
    """

    def __init__(self, x: FloatArray, points: int, blocks: int) -> None:
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
        near = {i: getattr(kept, "at", kept) for i, kept in self.near.items()}
        place = self.place and tuple(getattr(self.place, f.name) for f in fields(self.place))
        return {**self.__dict__, "factor": None, "size": None, "near": near, "place": place}

    def __setstate__(self, state: dict[str, Any]) -> None:
        place = state["place"]
        self.__dict__.update(state, place=place and Place(*place))

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
