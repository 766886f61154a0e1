"""Functions of time of compiled steps, tabulated ahead for a block of steps."""

from collections.abc import Callable, Sequence

import numpy as np

from sparsemor.core import Amplitude, FloatArray, FrameHistory
from sparsemor.core.protocols.separable import amplitudes_along
from sparsemor.reducers.step.time_tables import TimeTable


class NotCompiled(Exception):
    """A model whose steps are not compiled, with the reason."""


class Timed:
    """Functions of time in the columns of one table, in the order in which they were added."""

    def __init__(self) -> None:
        self.sources: list[Callable[[FloatArray], Sequence[FloatArray]]] = []
        self.width = 0
        self._known: list[tuple[tuple[Amplitude, ...], int]] = []

    def _added(self, source: Callable[[FloatArray], Sequence[FloatArray]], columns: int) -> int:
        self.sources.append(source)
        self.width += columns
        return self.width - columns

    def amplitudes(self, amplitudes: Sequence[Amplitude]) -> int:
        """Number of the first column of these amplitudes, -1 for none; equal ones are evaluated
        once."""
        if not amplitudes:
            return -1
        wanted = tuple(amplitudes)
        for known, column in self._known:
            if known == wanted:
                return column
        self._known.append((wanted, self._added(
            lambda times: [amplitudes_along(wanted, times)], len(wanted))))
        return self._known[-1][1]

    def motion(self, guide: FrameHistory | None, rigid: int) -> int:
        """Number of the first column of a prescribed motion, its rates and second derivatives, -1
        for none; rigid: number of rigid coordinates."""
        return -1 if guide is None else self._added(guide.along, 3 * rigid)

    def table(self, table: TimeTable, columns: int) -> int:
        """Number of the first column of this many first values of a function of time."""
        return self._added(lambda times: [table.along(times)[:, :columns]], columns)

    def along(self, times: FloatArray) -> FloatArray:
        """Values (T, width) at times (T,), s."""
        parts = [part for source in self.sources for part in source(times)]
        return np.ascontiguousarray(np.hstack([np.zeros((len(times), 0)), *parts]))
