"""Local copies of terms: cheaper, and exact near a state, such as a contact with a neighbour list
(`ReducedTerm.near`). They are kept in the step memory."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from sparsemor.core import FloatArray, IntArray, ReducedTerm
from sparsemor.core.protocols.term import DelegatingTerm, LocalCopy


class CopyMemory(Protocol):
    """Step memory with local copies of terms. near: number of a term -> its copy, or the state at
    which it was made; searches: number of copies made so far."""

    near: dict[int, LocalCopy | FloatArray]
    searches: int


@dataclass(frozen=True, slots=True, eq=False)
class Coupled:
    """A projected term: `columns` (k,) unknowns that it depends on, `rows` (l,) that it contributes
    to, all numbered as in the reduced model."""

    term: ReducedTerm
    rows: IntArray
    columns: IntArray

    def by_copies(self, number: int, memory: CopyMemory) -> "Coupled":
        """The same, evaluated by local copies in `memory`, kept there under `number`, if the term
        offers any: cheaper, and exact near the state at which they are made."""
        return replace(self, term=Relocalised(self.term, number, memory)) if (
            self.term.relocates) else self


@dataclass(frozen=True, slots=True, eq=False)
class OfAtoms(DelegatingTerm):
    """A term as a function of the inputs `some` among `count`; the others are zero."""

    term: ReducedTerm
    some: IntArray
    count: int

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return self.term.residual(self._wide(x), self._wide(v), self._wide(a), t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        J: FloatArray = self.term.jacobian(
            self._wide(x), self._wide(v), self._wide(a), t, self._wide(c1), self._wide(c2))
        return J[:, self.some]

    def _wide(self, x: FloatArray) -> FloatArray:
        found = np.zeros(self.count)
        found[self.some] = x
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Relocalised(DelegatingTerm):
    """A reduced term evaluated by its local copy, which is renewed where it is no longer exact.
    number: key of the copy in `memory.near`; `memory.searches` counts the copies made."""

    term: ReducedTerm
    number: int
    memory: CopyMemory

    def at(self, x: FloatArray) -> LocalCopy | None:
        """The local copy for a state; None for a state that is not finite."""
        kept = self.memory.near.get(self.number)
        if isinstance(kept, np.ndarray):  # of a memory that was stored: made there again
            kept = self.memory.near[self.number] = self.term.near(kept)
        if kept is not None and kept.holds(x):  # still exact at x
            return kept
        if not np.isfinite(x).all():
            return None
        self.memory.searches += 1
        kept = self.memory.near[self.number] = self.term.near(x)
        return kept

    def residual(self, x: FloatArray, v: FloatArray, a: FloatArray, t: float) -> FloatArray:
        return (self.at(x) or self.term).residual(x, v, a, t)

    def jacobian(
        self, x: FloatArray, v: FloatArray, a: FloatArray, t: float, c1: FloatArray, c2: FloatArray
    ) -> FloatArray:
        return (self.at(x) or self.term).jacobian(x, v, a, t, c1, c2)

    def check_step(self, x: FloatArray, v: FloatArray, t: float, h: float) -> str:
        copy = self.at(x)
        return "" if copy is None else copy.check_step(x, v, t, h)

    def resultants(self, x: FloatArray, v: FloatArray, t: float) -> Mapping[str, float]:
        copy = self.at(x)
        return {} if copy is None else copy.resultants(x, v, t)


def state_of(kept: LocalCopy | FloatArray) -> FloatArray:
    """State (k,) at which a local copy of a term was made; in a stored memory the entry is that
    state."""
    return kept if isinstance(kept, np.ndarray) else kept.at
