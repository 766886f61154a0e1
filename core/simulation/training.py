"""Training snapshots: full-order states at the start and after every few steps, block by block."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from sparsemor.core.arrays import FloatArray
from sparsemor.core.linalg.snapshots import SnapshotWriter
from sparsemor.core.protocols import State
from sparsemor.core.protocols.layout import Layout
from sparsemor.core.scene.scene import Scene


class SnapshotKeeper:
    """Snapshots of the full-order run of `scene`, taken while it goes.

    Per block (M, n): the start, each `training.every` steps and, for integrators of an order above
    1, whose first step carries the first accelerations on, x + h^2 a of the start at last.
    """

    def __init__(
        self, scene: Scene, steps: int, layout: Layout, blocks: tuple[str, ...],
        folder: Callable[[], Path],
    ) -> None:
        self.every, self._h, self._layout = scene.training.every, scene.time.step, layout
        extra = int(scene.integrator.order > 1)
        count = steps // self.every + 1 + extra
        self._kept = {n: SnapshotWriter(n, count, layout[n].stop - layout[n].start, folder)
                      for n in blocks}
        self._first = np.zeros(0) if extra else None

    def take(self, step: int, state: State) -> None:
        """The state after `step` steps; 0: the start."""
        if step == 0 and self._first is not None:
            self._first = state.x + self._h * self._h * state.a
        if step % self.every == 0:
            for name, rows in self._kept.items():
                rows.append(state.x[self._layout[name]])

    def finished(self) -> Mapping[str, FloatArray]:
        """Block -> (M, n), after the last step."""
        for name, rows in self._kept.items():
            if self._first is not None:
                rows.append(self._first[self._layout[name]])
        return {name: rows.finished() for name, rows in self._kept.items()}

    def close(self) -> None:
        """Releases files, also after a run that failed."""
        for rows in self._kept.values():
            rows.close()
