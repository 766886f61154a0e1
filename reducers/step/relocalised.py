"""Terms that follow the motion: evaluated by a lighter copy that holds near a state.

A reduced term may have `near(x)`, a copy for states near x, with `holds(x)` and the state `at`
that it was made at. Such copies give what the whole term gives, and the step memory keeps them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sparsemor.core import FloatArray, RelocatesNear
from sparsemor.reducers.step.newton.memory import NewtonMemory
from sparsemor.reducers.step.reduced_residual import Coupled


class Relocalised:
    """A `ReducedTerm`: the copy at hand, or a new one where that does not hold any more."""

    __slots__ = ("memory", "number", "term")

    def __init__(self, term: Any, number: int, memory: NewtonMemory) -> None:
        self.term, self.number, self.memory = term, number, memory

    @property
    def elements(self) -> int:
        return int(self.term.elements)

    @property
    def source(self) -> str:
        return str(self.term.source)

    @property
    def histories(self) -> tuple[str, ...]:
        found: tuple[str, ...] = self.term.histories
        return found

    def at(self, x: FloatArray) -> Any:
        """The copy for a state."""
        kept = self.memory.near.get(self.number)
        if isinstance(kept, np.ndarray):  # of a memory that was stored: made there again
            kept = self.memory.near[self.number] = self.term.near(kept)
        if kept is not None and kept.holds(x):
            return kept
        if not np.isfinite(x).all():
            return self.term
        self.memory.searches += 1
        kept = self.memory.near[self.number] = self.term.near(x)
        return kept

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        r: FloatArray = self.at(x).residual(x, v, a, t)
        return r

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        J: FloatArray = self.at(x).jacobian(x, v, a, t, c1, c2)
        return J

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        return str(self.at(x).check_step(x, v, t, h))

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> dict[str, float]:
        found: dict[str, float] = self.at(x).resultants(x, v, t)
        return found


def movable(coupled: Sequence[Coupled]) -> tuple[int, ...]:
    """Positions of the terms that follow the motion."""
    return tuple(i for i, c in enumerate(coupled) if isinstance(c.term, RelocatesNear))


def following(
    coupled: Sequence[Coupled], which: Sequence[int], memory: NewtonMemory
) -> list[Coupled]:
    """The same terms, those at positions `which` with their copies in `memory`."""
    found = list(coupled)
    for i in which:
        found[i] = replace(found[i], term=Relocalised(found[i].term, i, memory))
    return found
