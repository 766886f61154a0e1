"""Resampling: the sampled rows of the residual change during the run; a step solver for each set of
rows."""

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sparsemor.core import (
    BoolArray,
    IntArray,
    SolveFailed,
    State,
    StepFormula,
    StepMemory,
    StepOutcome,
    StepSolver,
)
from sparsemor.core.protocols.step_solver import AroundSteps
from sparsemor.reducers.step.step_memory import RunMemory

Streams = Mapping[str, np.random.Generator]
Draw = Callable[[Streams], Mapping[str, IntArray]]
"""Function that draws the rows of every block from the random streams of the blocks."""


def branched(streams: Streams) -> dict[str, np.random.Generator]:
    """Block -> new random generator for one draw. Every stream advances by the same amount whatever
    is drawn, so that a draw from the cache does not change later ones."""
    return {n: np.random.default_rng(s.integers(2**63, size=2)) for n, s in streams.items()}


@dataclass(eq=False)
class ResampledMemory(StepMemory):
    """State between steps of a run with resampling. inner: state of the current step solver;
    streams: random streams of further draws; step: number of steps so far; turn: number of changes
    of rows; rows, current: for
    newly drawn rows, the rows in use and their step solver, which is rebuilt after a restart."""

    inner: RunMemory
    streams: Streams
    step: int = 0
    turn: int = 0
    rows: Mapping[str, IntArray] | None = None
    current: StepSolver | None = None

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "current": None}

    def copy(self) -> Self:
        """Independent copy of the state; the step solver of the rows in use is shared."""
        return replace(self, inner=self.inner.copy(), streams=deepcopy(self.streams))


@dataclass(frozen=True, slots=True, eq=False)
class Resampled(AroundSteps[StepSolver]):
    """Step solver whose sampled rows change every `every` steps. base: step solver of the first
    rows.

    sets: step solvers that are used in turn. draw, fresh: for new rows in every draw, the functions
    that draw them and assemble their step solver; streams: initial random streams. A draw evaluates
    the sampler on all rows of the mesh; a step evaluates the drawn rows only.
    """

    sets: tuple[StepSolver, ...]
    every: int
    draw: Draw | None
    fresh: Callable[[Mapping[str, IntArray], int], StepSolver] | None
    streams: Streams

    def __post_init__(self) -> None:
        AroundSteps.__post_init__(self)
        touched = [s.elements_touched for s in self.sets]  # of the set of rows with the most
        object.__setattr__(self, "elements_touched", {
            name: max(t[name] for t in touched) for name in touched[0]})
        object.__setattr__(self, "notes", tuple(dict.fromkeys(
            note for s in self.sets for note in s.notes)))

    def start(self, state: State) -> tuple[State, ResampledMemory]:
        reduced, inner = self.base.start(state)
        return reduced, ResampledMemory(inner, deepcopy(dict(self.streams)))

    def solve(
        self, step: StepFormula, memory: ResampledMemory
    ) -> tuple[StepOutcome, ResampledMemory]:
        """A step on the present rows, which are drawn again every `every` steps; a failure, at the
        extrapolated state, where new rows do not distinguish the atoms."""
        try:
            if memory.step and memory.step % self.every == 0:
                self._change(memory)
            solver = self.at_rows(memory)
        except SolveFailed as error:
            x = step.free + memory.inner.past.guess(step)
            return StepOutcome(x, error.status, 0, error.block, error.detail), memory
        memory.step += 1
        outcome, memory.inner = solver.solve(step, memory.inner)
        return outcome, memory

    def _change(self, memory: ResampledMemory) -> None:
        """Changes to the next set of rows; reduced operators of the previous rows are dropped if
        these are not used again."""
        memory.turn += 1
        if self.draw is not None:
            memory.rows, memory.current = self.draw(branched(memory.streams)), None
        memory.inner.rows_changed(fresh=self.draw is not None)

    def at_rows(self, memory: ResampledMemory) -> StepSolver:
        """Step solver of the rows in use."""
        if self.fresh is None or memory.rows is None:
            return self.sets[memory.turn % len(self.sets)]
        if memory.current is None:
            memory.current = self.fresh(memory.rows, memory.turn)
        return memory.current

    def frozen(self, memory: ResampledMemory) -> tuple[StepSolver, StepMemory]:
        """Step solver with fixed rows and supports, those in use, and its memory: for
        linearisation."""
        solver, inner = self.at_rows(memory), memory.inner
        return solver.frozen(inner)

    def rows_at(self, memory: ResampledMemory) -> Mapping[str, IntArray]:
        """Sampled rows (m,) of each block that are in use."""
        return self.at_rows(memory).rows

    def supports(self, memory: ResampledMemory) -> Mapping[str, BoolArray]:
        return self.base.supports(memory.inner)

    def counters(self, memory: ResampledMemory) -> Mapping[str, int]:
        return {**self.base.counters(memory.inner), "resamplings": memory.turn}
