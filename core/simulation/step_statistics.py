"""Statistics of a run: wall times, iterations and active atoms, summed over its steps."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sparsemor.core.arrays import BoolArray
from sparsemor.core.protocols.integrator import StepOutcome


@dataclass
class StepStatistics:
    """Statistics of a run, stored in its checkpoints; their size does not grow with the number of
    steps.

    offline, online: wall time, s; done: number of steps; last_seconds, last_iterations,
    last_remaining (`StepOutcome.remaining`): those of the last step; seconds_near: k -> number of
    steps whose solution took exp(k / 100) s, within 0.5 %; active: block -> number of active atoms,
    summed over the steps; full_steps, full_seconds: number of steps of a reduced run that were
    solved at full order, and wall time for these and their preparation, s; controllers: what they
    remember.
    """

    offline: float = 0.0
    online: float = 0.0
    done: int = 0
    iterations: int = 0
    last_seconds: float = 0.0
    last_iterations: int = 0
    last_remaining: float = 0.0
    seconds_near: dict[int, int] = field(default_factory=dict)
    active: dict[str, int] = field(default_factory=dict)
    full_steps: int = 0
    full_seconds: float = 0.0
    controllers: dict[str, tuple[float, ...]] = field(default_factory=dict)

    def add(self, seconds: float, outcome: StepOutcome) -> None:
        """Counts a solved step, whose solution took so many seconds."""
        self.done += 1
        self.iterations += outcome.iterations
        self.last_seconds, self.last_iterations = seconds, outcome.iterations
        self.last_remaining = outcome.remaining
        k = round(100.0 * math.log(max(seconds, 1e-9)))
        self.seconds_near[k] = self.seconds_near.get(k, 0) + 1

    @property
    def ms_per_step(self) -> float:
        """Mean wall time per step, storage of results included, ms."""
        return 1e3 * self.online / self.done if self.done else 0.0

    @property
    def ms_per_step_solver(self) -> float:
        """Median wall time of the step solver's call alone, ms, within 0.5 %."""
        seen = 0
        for k in sorted(self.seconds_near):
            seen += self.seconds_near[k]
            if 2 * seen >= self.done:
                return 1e3 * math.exp(k / 100.0)
        return 0.0

    def count_atoms(self, supports: Mapping[str, BoolArray]) -> None:
        for name, support in supports.items():
            self.active[name] = self.active.get(name, 0) + int(np.count_nonzero(support))
