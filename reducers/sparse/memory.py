"""Step memory of a reduced model that selects atoms."""

from collections.abc import Callable
from typing import Any, Self

from sparsemor.core import FloatArray
from sparsemor.reducers.sparse.elastic_screen import Screens
from sparsemor.reducers.step.iteration_state import Workspace
from sparsemor.reducers.step.solver import Memory, Stepper

KEPT = 64
"""Prepared supports kept per run: a support often comes back."""


class SparseMemory(Memory):
    """Adds the stepper of the current supports; prepared arrays are rebuilt after a restart.

    Keys of what is kept begin with the number of the set of rows.
    """

    def __init__(self, x: FloatArray, points: int, work: Workspace) -> None:
        super().__init__(x, points, work)
        self.step = 0
        self.prepared: dict[tuple[int, str, bytes], Any] = {}
        self.screens: dict[int, Screens | None] = {}
        self.steppers: dict[tuple[int, bytes], Stepper] = {}
        self.current: Stepper | None = None

    def __getstate__(self) -> dict[str, Any]:
        prepared: dict[str, Any] = {"prepared": {}, "screens": {}, "steppers": {}, "current": None}
        return {**super().__getstate__(), **prepared}

    def copy(self) -> Self:
        """Separate memory of the same state. What was prepared for supports does not change and is
        shared; screens do, and are made again from the state, as after a restart."""
        other = super().copy()
        other.prepared, other.steppers, other.screens = dict(self.prepared), dict(self.steppers), {}
        return other

    def forget(self) -> None:
        """Everything that was prepared for supports: the rows are others now."""
        self.prepared, self.screens, self.steppers, self.current = {}, {}, {}, None

    def kept(self, key: tuple[int, str, bytes], make: Callable[[], Any]) -> Any:
        """Prepared arrays, made when they are not there; the oldest go when there are many."""
        if key not in self.prepared:
            if len(self.prepared) >= KEPT:
                self.prepared.pop(next(iter(self.prepared)))
            self.prepared[key] = make()
            self.factorizations += 1
        return self.prepared[key]

    def stepper(self, key: tuple[int, bytes], make: Callable[[], Stepper]) -> Stepper:
        """The same for whole steppers, by all supports together."""
        if key not in self.steppers:
            if len(self.steppers) >= KEPT:
                self.steppers.pop(next(iter(self.steppers)))
            self.steppers[key] = make()
        return self.steppers[key]
