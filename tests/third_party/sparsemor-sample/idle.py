"""A check of runs in a package of its own: what never changes, and what stops a run."""

from collections.abc import Mapping

import numpy as np

from sparsemor.core import (
    BoolArray,
    Check,
    Findings,
    FloatArray,
    OnStep,
    PreparedRun,
    RunResult,
    State,
    information,
)


class Idle(Check):
    """Blocks whose unknowns never change in a run."""

    _start: FloatArray | None = None
    _moved: BoolArray | None = None

    def on_start(self, run: PreparedRun, state: State, whole: bool) -> OnStep | None:
        if self._start is None:
            self._start, self._moved = state.x, np.zeros(len(state.x), dtype=np.bool_)
        return self._look if whole else None

    def _look(
        self, done: int, before: State, state: State, active: Mapping[str, BoolArray]
    ) -> None:
        self._moved |= state.x != self._start

    def after_run(self, run: PreparedRun, result: RunResult) -> Findings:
        layout, moved = run.solver.layout, self._moved
        idle = [] if moved is None else [
            b.name for b in layout if b.size and not moved[layout[b.name]].any()]
        return Findings([information(f"{name} never changes", "idle") for name in idle],
                        {"idle": idle})
