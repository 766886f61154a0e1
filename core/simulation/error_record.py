"""Record of error estimates of a reduced run at its stored steps, and their comparison with a
tolerance while it runs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.protocols.integrator import State
from sparsemor.core.protocols.reducer import ErrorEstimator

TOGETHER = 256
"""Least number of states that are evaluated at once: products of matrices instead of vectors."""

LARGEST = float(np.finfo(np.float64).max)


@dataclass(frozen=True, slots=True, eq=False)
class ErrorMark:
    """A moment of a record: memory of the estimate, numbers of values and of marked states."""

    memory: Mapping[str, FloatArray]
    values: int
    stored: int


class ErrorRecord:
    """Error estimates of one run, evaluated for several states at once, and kept for those steps
    that are stored. Between two estimates the last one counts.

    memory: state of the estimate (`ErrorEstimator.start`) at the last evaluated step; changes:
    block -> largest change of its unknowns since the start (2-norm), in training (the argument) or
    in the run so far (`ErrorMonitor`); a checkpoint contains both. exact: True where the steps are
    of full order and add nothing to the error.
    """

    def __init__(
        self, estimator: ErrorEstimator, full: State, reduced: State,
        changes: Mapping[str, float] | None = None,
    ) -> None:
        self.estimator, self.exact = estimator, False
        known = changes or {}
        self.changes = {n: known.get(n, 0.0) for n in estimator.blocks}
        self.restart(estimator.start(full, reduced))

    def restart(self, memory: dict[str, FloatArray]) -> None:
        """Continues from a stored memory."""
        self.memory = memory
        self._path: list[State] = []  # since the last estimate
        self._pending: list[list[State]] = []  # paths from one estimate to the next
        self._values = {n: [v] for n, v in self.estimator.present(memory).items()}
        self._stored: list[int] = []  # index of the estimate that belongs to each stored step
        self._count = 1  # of estimates, with those of pending states

    def carried(self) -> dict[str, Any]:
        """Data from which a stopped run continues: memory, changes, the last estimates, and the
        states since then, each with its time as one row."""
        values = self.present()
        return {"memory": self.memory, "changes": self.changes, "values": values,
                "path": [np.concatenate([[s.t], s.x, s.v, s.a]) for s in self._path]}

    def resume(self, kept: Mapping[str, Any], size: int) -> None:
        """Continues from the data of a checkpoint (`carried`), with states of `size` unknowns.
        Raises ValueError for states of another size."""
        self.restart(kept["memory"])
        self.changes.update(kept["changes"])
        self._values = {n: [kept["values"][n]] for n in self._values}
        for row in kept["path"]:
            x, v, a = np.reshape(row[1:], (3, size))
            self._path.append(State(float(row[0]), x, v, a, np.zeros((size, 0))))

    def take(self, state: State, step: int) -> None:
        """The state after a step of this number, counted from the start of the run."""
        self._path.append(state)
        if step % self.estimator.every if self.exact else not self.estimator.due(step):
            return
        self._pending.append(self._path)
        self._path = []
        self._count += 1
        if len(self._pending) * self.estimator.every >= TOGETHER or self.exact:
            self._evaluate()

    def store(self) -> None:
        """Marks the last state as one that is stored."""
        self._stored.append(self._count - 1)

    def stored(self) -> Mapping[str, FloatArray]:
        """Block -> norms (j,) of its estimated error at the j states that were marked since the
        last call."""
        self._evaluate()
        found = {n: np.array(v)[self._stored] for n, v in self._values.items()}
        self._values = {n: v[-1:] for n, v in self._values.items()}
        self._stored, self._count = [], 1
        return found

    def present(self) -> dict[str, float]:
        """Estimated error norm of each block at the last state with an estimate."""
        self._evaluate()
        return {n: v[-1] for n, v in self._values.items()}

    def mark(self) -> ErrorMark:
        """The present moment, to come back to."""
        self._evaluate()
        return ErrorMark(dict(self.memory), self._count, len(self._stored))

    def roll_back(self, mark: ErrorMark) -> None:
        """Drops what came after a moment, since which nothing was written."""
        self.memory, self._count = dict(mark.memory), mark.values
        self._path, self._pending = [], []
        self._values = {n: v[: mark.values] for n, v in self._values.items()}
        del self._stored[mark.stored:]

    def _evaluate(self) -> None:
        """Evaluates the estimates at the ends of all pending paths."""
        found = self.estimator.carry(len(self._pending), self.memory) if self.exact else (
            self.estimator.advance(self._pending, self.memory))
        for name, norms in found.items():
            # of a run that diverges an estimate may overflow; a result has finite numbers
            self._values[name] += np.nan_to_num(norms, nan=LARGEST, posinf=LARGEST).tolist()
        self._pending = []
