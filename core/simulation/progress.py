"""Progress bar of a run in the terminal, by the observer plugin `progress`."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from sparsemor.core.registry.registry import Registry


@contextmanager
def progress_bar(shown: bool) -> Iterator[Sequence[object]]:
    """Context with the observers that show the bar; none if it is not to be shown."""
    registry = Registry()
    if not shown or not registry.has("observer", "progress"):
        yield ()
        return
    plugin: Any = registry.get("observer", "progress")()
    observer = plugin.observer()
    try:
        yield (observer,)
    finally:
        observer.close()
