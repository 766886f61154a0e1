"""Progress in a notebook: one line of text, which is replaced as a run goes on."""

import sys
import time
from importlib import import_module
from typing import Any

from sparsemor.core import RunStart, hookimpl


def in_notebook() -> bool:
    """True in the kernel of a notebook, which shows objects."""
    found = sys.modules.get("IPython")
    shell = None if found is None else found.get_ipython()
    return shell is not None and shell.has_trait("kernel")


class NotebookLine:
    """One output of a cell, at most `refresh` times a second another text."""

    def __init__(self, refresh: float = 4.0) -> None:
        self._refresh, self._next = refresh, 0.0
        self._handle: Any = None

    def show(self, text: str, now: bool = False) -> None:
        """Shows a text, unless the last one is too new; `now`: in any case."""
        clock = time.monotonic()
        if not now and clock < self._next:
            return
        self._next = clock + 1.0 / self._refresh
        shown = {"text/plain": text}
        if self._handle is None:
            self._handle = import_module("IPython.display").DisplayHandle()
            self._handle.display(shown, raw=True)
        else:
            self._handle.update(shown, raw=True)


class NotebookProgress:
    """Observer that shows what is computed and the time that a run has reached."""

    def __init__(self, refresh: float) -> None:
        self._line, self._label, self._text, self._end = NotebookLine(refresh), "", "", 0.0

    @hookimpl
    def on_start(self, run: RunStart) -> None:
        self._label, self._end = label_of(run), run.t_end
        self._line.show(f"{self._label}: {run.steps} steps to {run.t_end:g} s")

    @hookimpl
    def on_offline(self, product: str) -> None:
        self._line.show(f"offline: {product.replace('_', ' ')}")

    @hookimpl
    def on_step(self, step: int, t: float) -> None:
        self._text = f"{self._label}: t = {t:.4g} of {self._end:g} s, {step} steps"
        self._line.show(self._text)

    def close(self) -> None:
        """Shows where the run has ended."""
        if self._text:
            self._line.show(self._text, now=True)


def label_of(run: RunStart) -> str:
    """Title and reducer of a run, and its phase if it is not the run itself."""
    label = f"{run.title} {run.reducer}".strip()
    return label + ("" if run.phase == "run" else f" ({run.phase})")
