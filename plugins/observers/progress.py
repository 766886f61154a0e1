"""Progress bar on the terminal, or a line of text in a notebook that is replaced as a run goes on:
simulated time, steps per second, remaining time; before the first step, what is computed."""

import sys
import time
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pydantic import Field

from sparsemor.core import (
    Observer,
    RunStart,
    hookimpl,
)

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, ProgressColumn, TaskID

class ProgressBar(Observer):
    """Progress bar of a run on standard error."""

    refresh: float = Field(default=4.0, gt=0)
    """Redraws of the bar per second, 1/s."""

    def observer(self, console: "Console | None" = None) -> "RunningBar | NotebookProgress":
        """New observer for one run (and its training run): a bar, or a line in a notebook."""
        if console is None and in_notebook():
            return NotebookProgress(self.refresh)
        return RunningBar(self.refresh, console)


class RunningBar:
    """Observer that shows the bar in the terminal's last line from `on_start` to `on_finish`, and
    the product that is being computed before."""

    def __init__(self, refresh: float, console: "Console | None") -> None:
        self._refresh, self._console = refresh, console
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        self._steps = 0

    @hookimpl
    def on_start(self, run: RunStart) -> None:
        self.close()
        self._bar = self._new_bar(_run_columns())
        self._steps = 0
        self._task = self._bar.add_task(
            label_of(run), total=run.steps, t=run.t_start, end=run.t_end)
        self._bar.start()

    @hookimpl
    def on_offline(self, product: str) -> None:
        self.close()
        self._bar = self._new_bar(_offline_columns())
        self._bar.add_task(f"offline: {product.replace('_', ' ')}", total=None)
        self._bar.start()

    @hookimpl
    def on_step(self, t: float) -> None:
        if self._bar is not None and self._task is not None:
            self._steps += 1
            self._bar.update(self._task, completed=self._steps, t=t)

    @hookimpl
    def on_finish(self) -> None:
        self.close()

    def close(self) -> None:
        """Remove the bar from the terminal, if it is shown."""
        if self._bar is not None:
            self._bar.stop()
        self._bar = self._task = None

    def _new_bar(self, columns: "list[ProgressColumn]") -> "Progress":
        return terminal_bar(*columns, refresh=self._refresh, console=self._console)


def terminal_bar(
    *columns: "ProgressColumn", refresh: float = 4.0, console: "Console | None" = None
) -> "Progress":
    """Progress display in the last line of standard error, or of a console, which vanishes at its
    end."""
    from rich.console import Console
    from rich.progress import Progress

    return Progress(*columns, console=console or Console(stderr=True),
                    refresh_per_second=refresh, transient=True)


def _offline_columns() -> "list[ProgressColumn]":
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    return [SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()]


def _run_columns() -> "list[ProgressColumn]":
    from rich.progress import BarColumn, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class Rate(ProgressColumn):
        def render(self, task: Any) -> Text:
            return Text(f"{task.speed:.0f} steps/s" if task.speed else "")

    return [TextColumn("{task.description}"), BarColumn(),
            TextColumn("t = {task.fields[t]:.4g} of {task.fields[end]:g} s"),
            Rate(), TimeRemainingColumn()]


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
