"""Deferred Ctrl-C: a run stops between two steps, in a state from which it can be resumed."""

import signal
import threading
from types import FrameType, TracebackType
from typing import Any


class Interrupt:
    """Context in which a first Ctrl-C only sets `wanted`; a second one stops at once, as usual.

    Without effect outside the main thread, where Python sets no signal handlers, or where Ctrl-C is
    ignored.
    """

    def __init__(self) -> None:
        self.wanted = False
        self._before: Any = None

    def __enter__(self) -> "Interrupt":
        in_main = threading.current_thread() is threading.main_thread()
        if in_main and callable(signal.getsignal(signal.SIGINT)):
            self._before = signal.signal(signal.SIGINT, self._ask)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.wanted = True
        self._restore()

    def _restore(self) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
            self._before = None
