"""Progress of a study: a bar in a terminal, a line in a notebook, otherwise lines on standard
error."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from sparsemor.plugins.observers.progress import NotebookLine, in_notebook, terminal_bar
from sparsemor.plugins.study.plan import StudyPlan
from sparsemor.plugins.study.scheduler import Row, StudyProgress
from sparsemor.plugins.study.table_columns import cell

OnProgress = Callable[[StudyProgress, Row | None], None]
"""Callback for progress: called after each run with its row, and repeatedly with None while jobs
run."""


@contextmanager
def progress_display(plan: StudyPlan, quiet: bool) -> Iterator[OnProgress]:
    """Context manager: callback that displays the progress of a study; silent with `quiet`."""
    if quiet:
        yield lambda state, row: None
    elif in_notebook():
        line = NotebookLine()
        yield lambda state, row: line.show(
            f"{plan.study.name}: {in_words(state)}", now=state.done == state.total)
    elif sys.stderr.isatty():
        with _bar() as on_progress:
            yield on_progress
    else:
        yield lambda state, row: _line(plan, state, row)


def in_words(state: StudyProgress) -> str:
    """Progress as text, such as `12/216 done, 2 running, 1 failed, 3 min left`."""
    parts = [f"{state.done}/{state.total} done", f"{state.running} running",
             f"{state.failed} failed"]
    if state.lost:
        parts.append(f"{state.lost} workers lost")
    if state.seconds_left is not None:
        parts.append(f"{duration(state.seconds_left)} left")
    return ", ".join(parts)


def duration(seconds: float) -> str:
    """Duration as text, such as `40 s`, `12 min`, `3.5 h`."""
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5970 else f"{seconds / 3600:.1f} h"


def _line(plan: StudyPlan, state: StudyProgress, row: Row | None) -> None:
    if row is None:
        return
    settings = " ".join(f"{n}={cell(row[n])}" for n in plan.axes if row.get(n) is not None)
    print(f"run {row['run']}: {row['status']} ({settings}); {in_words(state)}", file=sys.stderr,
          flush=True)


@contextmanager
def _bar() -> Iterator[OnProgress]:
    from rich.progress import BarColumn, TextColumn

    with terminal_bar(BarColumn(), TextColumn("{task.description}")) as bar:
        task: Any = bar.add_task("starting", total=None)

        def on_progress(state: StudyProgress, row: Row | None) -> None:
            bar.update(task, total=state.total, completed=state.done, description=in_words(state))

        yield on_progress
