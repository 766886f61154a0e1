"""What a step that selects atoms carries to the next one."""

from collections.abc import Callable
from typing import Any

from sparsemor.core.arrays import FloatArray
from sparsemor.reducers.screens import Screens
from sparsemor.reducers.stepper import Memory, Stepper

KEPT = 64
"""Prepared supports kept per run: a support often comes back."""


class SparseMemory(Memory):
    """Adds the stepper of the current supports; prepared arrays are rebuilt after a restart.

    Keys of what is kept begin with the number of the set of rows.
    """

    def __init__(self, x: FloatArray, points: int) -> None:
        super().__init__(x, points)
        self.step = 0
        self.prepared: dict[tuple[int, str, bytes], Any] = {}
        self.screens: dict[int, Screens | None] = {}
        self.steppers: dict[tuple[int, bytes], Stepper] = {}
        self.current: Stepper | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "prepared": {}, "screens": {}, "steppers": {}, "current": None}

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
