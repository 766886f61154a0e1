"""Step memory of a reduced model that selects atoms."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self, TypeAlias, TypeVar

from sparsemor.reducers.sparse.elastic_screen import Screens
from sparsemor.reducers.step.elastic_block import CompressedElastic
from sparsemor.reducers.step.memory import Memory
from sparsemor.reducers.step.prescribed_frame_block import CompressedPrescribed
from sparsemor.reducers.step.solver import Stepper
from sparsemor.reducers.step.thermal_block import CompressedHeat

KEPT = 64
"""Prepared supports kept per run: a support often comes back."""
ElasticPart: TypeAlias = CompressedElastic | CompressedPrescribed
Supports: TypeAlias = tuple[int, str, bytes]
"""Number of the set of rows, block ("" for all together), and its support."""
K = TypeVar("K")
T = TypeVar("T")


@dataclass(eq=False, kw_only=True)
class SparseMemory(Memory):
    """Adds the stepper of the current supports, and what was prepared for others, by supports.
    All of that is rebuilt after a restart."""

    step: int = 0
    heat: dict[Supports, CompressedHeat] = field(default_factory=dict)
    elastic: dict[Supports, ElasticPart] = field(default_factory=dict)
    steppers: dict[Supports, Stepper] = field(default_factory=dict)
    screens: dict[int, Screens | None] = field(default_factory=dict)
    current: Stepper | None = None

    def __getstate__(self) -> dict[str, object]:
        return {**super().__getstate__(), "heat": {}, "elastic": {}, "screens": {},
                "steppers": {}, "current": None}

    def copy(self) -> Self:
        """Separate memory of the same state. What was prepared for supports does not change and is
        shared; screens do, and are made again from the state, as after a restart."""
        return replace(super().copy(), heat=dict(self.heat), elastic=dict(self.elastic),
                       steppers=dict(self.steppers), screens={})

    def rows_changed(self, fresh: bool) -> None:
        """Drops what was prepared for supports on the rows before, unless these come back."""
        self.current = None
        if fresh:
            self.heat, self.elastic, self.screens, self.steppers = {}, {}, {}, {}

    def counted_part(self, kept: dict[Supports, T], key: Supports, make: Callable[[], T]) -> T:
        """As `kept_or_made`, counted as a factorization where it is made."""
        def made() -> T:
            self.factorizations += 1
            return make()

        return kept_or_made(kept, key, made)


def kept_or_made(kept: dict[K, T], key: K, make: Callable[[], T]) -> T:
    """The entry of a key, made where there is none; the oldest one goes where there are many."""
    if key not in kept:
        if len(kept) >= KEPT:
            kept.pop(next(iter(kept)))
        kept[key] = make()
    return kept[key]
