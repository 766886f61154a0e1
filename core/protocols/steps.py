"""How one step of a model is solved, full or reduced."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from sparsemor.core.arrays import BoolArray, FloatArray, IntArray
from sparsemor.core.layout import Layout
from sparsemor.core.notes import Note
from sparsemor.core.protocols.integration import Integrator, State, StepFormula
from sparsemor.core.protocols.representation import Dictionary
from sparsemor.core.status import Status


@dataclass(frozen=True, slots=True, eq=False)
class StepOutcome:
    """x (n,) in the step solver's own layout. block: where it failed, if it did."""

    x: FloatArray
    status: Status
    iterations: int
    block: str = ""
    detail: str = ""


class StepSolver(Protocol):
    """Solves one step of one (full or reduced) model. Immutable; memory goes in and out.

    The memory's state is plain data or objects of which `start` makes one in the same place
    (core/saved.py), so that a stopped run can be continued.

    `dictionaries` maps block names to the map back to full unknowns (absent: kept as they are);
    `rows`, `elements_touched`: per block; `supports(memory)`: active atoms per budgeted block;
    `notes`: what a user should know before trusting the run; `facts`: block name ->
    numbers worth reporting (condition of its rows, interpolation points, elements kept).

    Optional, for the linearised one-step map (core/stability): `frozen(memory)` -> a step solver on
    the supports and rows that `memory` is at, and its memory; `alone()` -> elastic block ->
    (s, 2 s) how its active unknowns answer to their own r1 and r2, everything else held;
    `response(step, x)` -> (n, 2 n) how the solution x of a step answers to changes of [r1; r2],
    where the solver knows that better than differences tell. Optional, for error-controlled steps:
    `memory.moved(x)`, told that the next step starts at x. Optional, where blocks are solved by
    iteration: `linear_iterations(memory)` -> block -> iterations since `start`. Optional:
    `acting(memory)`, terms whose resultants are kept at the stored steps (core/acting.py).
    """

    @property
    def facts(self) -> Mapping[str, Mapping[str, float | int | str]]: ...
    @property
    def notes(self) -> tuple[Note, ...]: ...

    @property
    def layout(self) -> Layout: ...
    @property
    def dictionaries(self) -> Mapping[str, Dictionary]: ...
    @property
    def rows(self) -> Mapping[str, IntArray]: ...
    @property
    def elements_touched(self) -> Mapping[str, int]: ...
    def start(self, state: State) -> tuple[State, Any]:
        """From a full-order state to this solver's state (consistent rates) and memory."""
        ...

    def solve(self, step: StepFormula, memory: Any) -> tuple[StepOutcome, Any]: ...
    def supports(self, memory: Any) -> Mapping[str, BoolArray]: ...
    def counters(self, memory: Any) -> Mapping[str, int]:
        """"factorizations", "support_changes", ... counted since `start`."""
        ...


@runtime_checkable
class Resampling(Protocol):
    """What a step solver may have besides: rows that change during the run. `rows` are those of the
    start; `counters` then hold "resamplings"."""

    def rows_at(self, memory: Any) -> Mapping[str, IntArray]:
        """The rows in use, per block."""
        ...


@runtime_checkable
class Redraws(Protocol):
    """Optional ability of a reducer: every `resample` steps (None: never) its rows are redrawn."""

    @property
    def resample(self) -> int | None: ...


class Reducer(Protocol):
    """How one step is solved. model: a `core.model.Model`; offline: a `core.offline.Offline`.

    Optional, for the estimate of memory: `basis`, `bases` (pattern -> basis) and `force_basis` say
    whether a training run is needed; `snapshot_copies`: how many arrays as large as a block's
    snapshots it holds at once, where it reads them as a whole.
    """

    def prepare(
        self, model: Any, integrator: Integrator, h: float, offline: Any, rng: np.random.Generator
    ) -> StepSolver: ...
