"""Split of the computing time of a run into matrix operations and updates, by statistical
profiling.

A timer of the processor time interrupts a separate, short pass of the run every millisecond. Each
interval counts as a matrix operation if a function of a given list is being executed, otherwise as
an update. Processor time does not depend on other programs that run at the same time, and the
samples cost less than a percent.
"""

import json
import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePath
from types import FrameType

from sparsemor.core.errors import InputError
from sparsemor.core.results.files.temporary_folders import TemporaryFolder
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation import simulate as simulation
from sparsemor.plugins.publishing.listed_files import write_listed

SPLIT = "split.json"
"""File of the split in the folder of a run."""
INTERVAL = 1e-3
"""Processor time between two samples, s."""
LOOP = ("core/simulation/run_steps.py", "RunSteps._taken")


def split_of(folder: Path) -> Mapping[str, float]:
    """Split that is stored with a run. Raises InputError if there is none."""
    if not (folder / SPLIT).is_file():
        raise InputError(f"{folder} was not profiled")
    found: Mapping[str, float] = json.loads((folder / SPLIT).read_text(encoding="utf-8"))
    return found


def write_split(folder: Path, scene: Scene, steps: int, matrix: Sequence[str]) -> None:
    """Stores with a run the shares of its time loop over its first `steps` steps, and the sampled
    processor time: `matrix`, `update`, `seconds` and the number of `steps`.

    matrix: functions `file.py:Class.name` that are matrix operations. Raises OSError where the
    system has no timer of the processor time, or outside the main thread.
    """
    if not hasattr(signal, "setitimer") or (
            threading.current_thread() is not threading.main_thread()):
        raise OSError("profiling needs the main thread of a POSIX system")
    short = scene.using({"time.end": min(scene.time.end, steps * scene.time.step),
                         "training.end": scene.training_end}, label="profile")
    counted = Counted(matrix)
    with TemporaryFolder() as place, counted.sampling():
        simulation.simulate(short, out=place / "run")
    total = counted.matrix + counted.update
    share = counted.matrix / total if total > 0.0 else 0.0
    split = {"matrix": share, "update": 1.0 - share, "seconds": total,
             "steps": min(float(steps), round(scene.time.end / scene.time.step))}
    write_listed(folder, SPLIT, (json.dumps(split) + "\n").encode())


class Counted:
    """Processor time of samples by kind, s: `matrix` and `update`, of the time loop alone. matrix,
    at the start: functions `file.py:Class.name` that are matrix operations, with those that they
    call."""

    def __init__(self, matrix: Sequence[str]) -> None:
        self.places = [(file, name) for file, _, name in (text.partition(":") for text in matrix)]
        self.matrix = self.update = self._last = 0.0
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
        if kind := self.kind_of(frame):
            setattr(self, kind, getattr(self, kind) + spent)

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
        if code not in self._known:
            file, name = PurePath(code.co_filename), code.co_qualname
            is_matrix = any(name == n and file.match(f) for f, n in self.places)
            is_loop = name == LOOP[1] and file.match(LOOP[0])
            self._known[code] = "matrix" if is_matrix else "loop" if is_loop else "other"
        return self._known[code]
