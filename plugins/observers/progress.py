"""Progress bar on the terminal, or a line in a notebook: simulated time, steps per second,
remaining time; before the first step, what is computed."""

from typing import TYPE_CHECKING, Any

from pydantic import Field

from sparsemor.core import (
    Observer,
    RunStart,
    hookimpl,
)
from sparsemor.plugins.observers.notebook import NotebookProgress, in_notebook, label_of

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
