"""Split of the computing time of a run into matrix operations and updates, by statistical
profiling.

A timer of the processor time interrupts a separate, short pass of the run every millisecond. Each
interval counts as a matrix operation if a function of a given list is being executed, otherwise as
an update. Processor time does not depend on other programs that run at the same time, and the
samples cost less than a percent.
"""

import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import PurePath
from types import FrameType

from sparsemor.core.results.files.temporary import TemporaryFolder
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation import simulate as simulation

INTERVAL = 1e-3
"""Processor time between two samples, s."""
_LOOP = ("core/simulation/run_steps.py", "RunSteps._portion")


def profiled(scene: Scene, steps: int, matrix: Sequence[str]) -> Mapping[str, float]:
    """Shares of the time loop of a run over its first `steps` steps, and the sampled processor
    time: `matrix`, `update`, `seconds` and the number of `steps`.

    matrix: functions `file.py:Class.name` that are matrix operations. Raises OSError where the
    system has no timer of the processor time, or outside the main thread.
    """
    if not hasattr(signal, "setitimer") or (
            threading.current_thread() is not threading.main_thread()):
        raise OSError("profiling needs the main thread of a POSIX system")
    short = _shortened(scene, steps)
    counted = Counted(tuple(_place(text) for text in matrix))
    with TemporaryFolder() as folder, counted.sampling():
        simulation.simulate(short, out=folder / "run")
    total = counted.matrix + counted.update
    share = counted.matrix / total if total > 0.0 else 0.0
    taken = min(float(steps), round(scene.time.end / scene.time.step))
    return {"matrix": share, "update": 1.0 - share, "seconds": total, "steps": taken}


class Counted:
    """Processor time of samples by kind, s; places: (last parts of the file name, qualified name)
    of the matrix operations."""

    def __init__(self, places: Sequence[tuple[str, str]]) -> None:
        self.places = tuple(places)
        self.matrix = self.update = 0.0
        self._last = 0.0
        self._known: dict[object, str] = {}

    @contextmanager
    def sampling(self) -> Iterator[None]:
        """Context in which the processor time of this thread is sampled."""
        before = signal.signal(signal.SIGPROF, self._sample)
        self._last = time.thread_time()
        signal.setitimer(signal.ITIMER_PROF, INTERVAL, INTERVAL)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)

    def _sample(self, number: int, frame: FrameType | None) -> None:
        now = time.thread_time()
        spent, self._last = now - self._last, now  # a long call in C is one sample
        kind = self.kind_of(frame)
        if kind == "matrix":
            self.matrix += spent
        elif kind == "update":
            self.update += spent

    def kind_of(self, frame: FrameType | None) -> str:
        """`matrix` or `update` of the innermost frame of a stack; "" outside the time loop."""
        matrix = False
        while frame is not None:
            kind = self._kind(frame)
            if kind == "loop":
                return "matrix" if matrix else "update"
            matrix = matrix or kind == "matrix"
            frame = frame.f_back
        return ""

    def _kind(self, frame: FrameType) -> str:
        code = frame.f_code
        kind = self._known.get(code)
        if kind is None:
            file, name = PurePath(code.co_filename), code.co_qualname
            is_matrix = any(name == n and file.match(f) for f, n in self.places)
            is_loop = name == _LOOP[1] and file.match(_LOOP[0])
            kind = self._known[code] = "matrix" if is_matrix else "loop" if is_loop else "other"
        return kind


def _shortened(scene: Scene, steps: int) -> Scene:
    """The scene over its first steps, uncompiled where it can be compiled, with the training run of
    the whole."""
    end = min(scene.time.end, steps * scene.time.step)
    changes = {"time.end": end, "training.end": scene.training_end}
    return scene.using(changes, label="profile")


def _place(text: str) -> tuple[str, str]:
    file, _, name = text.partition(":")
    return file, name
