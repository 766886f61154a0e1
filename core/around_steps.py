"""A step solver around another one, which has the same unknowns, rows and notes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from sparsemor.core.arrays import IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.notes import Note
from sparsemor.core.protocols import Dictionary, StepSolver

S = TypeVar("S", bound=StepSolver, covariant=True)


@dataclass(frozen=True, eq=False)
class AroundSteps(Generic[S]):
    """Says of itself what `base` says."""

    base: S

    @property
    def layout(self) -> Layout:
        return self.base.layout

    @property
    def dictionaries(self) -> Mapping[str, Dictionary]:
        return self.base.dictionaries

    @property
    def rows(self) -> Mapping[str, IntArray]:
        return self.base.rows

    @property
    def elements_touched(self) -> Mapping[str, int]:
        return self.base.elements_touched

    @property
    def facts(self) -> Mapping[str, Mapping[str, float | int | str]]:
        return self.base.facts

    @property
    def notes(self) -> tuple[Note, ...]:
        return self.base.notes
