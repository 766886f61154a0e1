"""Step memory of a separated model."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from sparsemor.core import BoolArray, FloatArray
from sparsemor.reducers.step.acceptance import Scales
from sparsemor.reducers.step.iteration_state import Workspace
from sparsemor.reducers.step.predictor import Ring


@dataclass(eq=False, kw_only=True)
class RunMemory:
    """Memory of every step solver here: past states, counts, and the active atoms of blocks.

    All but working arrays and what is computed again from the rest is stored as plain data
    (core/results/saved_state.py): `__getstate__` leaves these out.
    """

    ring: Ring
    factorizations: int = 0
    support_changes: int = 0
    supports: dict[str, BoolArray] = field(default_factory=dict)

    def copy(self) -> Self:
        """Separate memory of the same state."""
        return replace(self, ring=self.ring.copy(), supports=dict(self.supports))

    def moved(self, x: FloatArray) -> None:
        """The next step starts at x, after steps of another size that another solver took."""
        self.ring.push(x)
        self.ring.restart()

    def rows_changed(self, fresh: bool) -> None:
        """Another set of rows is in use from the next step on; fresh: one that is never used
        again."""

    @property
    def newest(self) -> FloatArray:
        """(n,) the last state."""
        return np.asarray(self.ring.rows[self.ring.newest])


@dataclass(eq=False, kw_only=True)
class Memory(RunMemory):
    """Adds the scales and working arrays of condensed Newton, and counts of what replaced it.

    full_newton_steps: steps that Newton's method with the exact Jacobian solved;
    full_newton_next: those next to come that are not tried without it; linear: block -> iterations
    of its linear solver.
    """

    work: Workspace
    scales: Scales = field(default_factory=Scales)
    full_newton_steps: int = 0
    full_newton_next: int = 0
    linear: dict[str, int] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if name != "work"}

    def copy(self) -> Self:
        return replace(super().copy(), scales=self.scales.copy(), work=self.work.separate(),
                       linear=dict(self.linear))

    def counted(self, block: str, iterations: int) -> None:
        """Iterations that a linear solver took."""
        self.linear[block] = self.linear.get(block, 0) + iterations
