"""Resampling: the rows of the residual that are evaluated change during the run; one step solver
for each set of rows."""

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.core import (
    AroundSteps,
    BoolArray,
    FreezesSupport,
    IntArray,
    Note,
    SolveFailed,
    State,
    StepFormula,
    StepMemory,
    StepOutcome,
    StepSolver,
)
from sparsemor.reducers.step.memory import RunMemory

Streams = Mapping[str, np.random.Generator]
Draw = Callable[[Streams], Mapping[str, IntArray]]
"""Rows of every block from the blocks' own streams."""


def branched(streams: Streams) -> dict[str, np.random.Generator]:
    """A generator for one draw of each block; moves every stream on by as much, whatever it draws,
    so that a draw from a cache changes nothing after it."""
    return {n: np.random.default_rng(s.integers(2**63, size=2)) for n, s in streams.items()}


@dataclass(eq=False)
class ResampledMemory:
    """inner: of the solver in use; turn: how often rows changed; fresh rows: what they are, the
    streams that the next are drawn from, and their solver, which is rebuilt after a restart."""

    inner: RunMemory
    streams: Streams
    step: int = 0
    turn: int = 0
    rows: Mapping[str, IntArray] | None = None
    current: StepSolver | None = None

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "current": None}

    def copy(self) -> Self:
        """Separate memory of the same state; the solver of the rows in use is shared."""
        return replace(self, inner=self.inner.copy(), streams=deepcopy(self.streams))


@dataclass(frozen=True, slots=True, eq=False)
class Resampled(AroundSteps[StepSolver]):
    """Step solvers over sets of rows, each for `every` steps. base: on the rows of the start.

    sets: solvers that come back in turn. draw, fresh: for rows that are always new, how they are
    drawn and made into a solver; streams: where the draws begin. A draw asks the sampler, which
    looks at the candidates of the mesh; the step itself reads only the rows that were drawn.
    """

    sets: tuple[StepSolver, ...]
    every: int
    draw: Draw | None
    fresh: Callable[[Mapping[str, IntArray], int], StepSolver] | None
    streams: Streams

    @property
    def elements_touched(self) -> Mapping[str, int]:
        """Of the set of rows that touches most."""
        touched = [s.elements_touched for s in self.sets]
        return {name: max(t[name] for t in touched) for name in touched[0]}

    @property
    def notes(self) -> tuple[Note, ...]:
        """Of all sets that are known, each once."""
        return tuple(dict.fromkeys(note for s in self.sets for note in s.notes))

    def start(self, state: State) -> tuple[State, ResampledMemory]:
        reduced, inner = self.base.start(state)
        return reduced, ResampledMemory(inner, deepcopy(dict(self.streams)))

    def solve(
        self, step: StepFormula, memory: ResampledMemory
    ) -> tuple[StepOutcome, ResampledMemory]:
        try:
            if memory.step and memory.step % self.every == 0:
                self._change(memory)
            solver = self.at_rows(memory)
        except SolveFailed as error:
            x = memory.inner.ring.predict()
            return StepOutcome(x, error.status, 0, error.block, error.detail), memory
        memory.step += 1
        outcome, memory.inner = solver.solve(step, memory.inner)
        return outcome, memory

    def _change(self, memory: ResampledMemory) -> None:
        """Other rows from this step on; what was prepared for supports on the old ones goes."""
        memory.turn += 1
        if self.draw is not None:
            memory.rows, memory.current = self.draw(branched(memory.streams)), None
        memory.inner.rows_changed(fresh=self.draw is not None)

    def at_rows(self, memory: ResampledMemory) -> StepSolver:
        """The solver on the rows that `memory` is at."""
        if self.fresh is None or memory.rows is None:
            return self.sets[memory.turn % len(self.sets)]
        if memory.current is None:
            memory.current = self.fresh(memory.rows, memory.turn)
        return memory.current

    def frozen(self, memory: ResampledMemory) -> tuple[StepSolver, StepMemory]:
        """The solver on the rows and supports that `memory` is at, and its memory."""
        solver, inner = self.at_rows(memory), memory.inner
        return solver.frozen(inner) if isinstance(solver, FreezesSupport) else (solver, inner)

    def rows_at(self, memory: ResampledMemory) -> Mapping[str, IntArray]:
        """The rows in use."""
        return self.at_rows(memory).rows

    def supports(self, memory: ResampledMemory) -> Mapping[str, BoolArray]:
        return self.base.supports(memory.inner)

    def counters(self, memory: ResampledMemory) -> Mapping[str, int]:
        return {**self.base.counters(memory.inner), "resamplings": memory.turn}
