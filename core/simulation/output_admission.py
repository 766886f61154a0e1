"""Checks of the output directory before a run, and clean-up after a refused run."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.results.arrays_in_memory import MemoryWriter
from sparsemor.core.results.checkpoint import checkpoint_file
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.store import ResultWriter
from sparsemor.core.scene.scene import Scene


def admit(scene: Scene, out: Path, resume: bool) -> None:
    """Checks, before anything is computed, that a run may write to `out`, or with `resume` continue
    the result in it. Raises InputError."""
    directory = OutputDirectory(out)
    if resume:
        ResultWriter.resumable(directory.store, scene)
    else:
        directory.require_writable()


@contextmanager
def kept(writer: ResultWriter | MemoryWriter, new: bool) -> Iterator[None]:
    """Context that deletes a new result if its run is refused by an input error, or fails before
    its first checkpoint."""
    try:
        yield
    except (InputError, OSError) as error:
        if new and isinstance(writer, ResultWriter):
            first = not checkpoint_file(writer.path).exists()
            if first or isinstance(error, InputError) and not isinstance(error, Damaged):
                writer.discard()
        raise
