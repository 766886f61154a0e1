"""Admission of a run to its output directory, and what a refused run leaves there."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.results.checkpoint import checkpoint_file
from sparsemor.core.results.output_directory import OutputDirectory
from sparsemor.core.results.store import ResultWriter
from sparsemor.core.scene.run_identity import Identity
from sparsemor.core.scene.scene import Scene


def admit(scene: Scene, out: Path, resume: bool) -> None:
    """Raises InputError when a run may not write to `out`: asked before anything is computed."""
    directory = OutputDirectory(out)
    if resume:
        ResultWriter.resumable(directory.store, scene.digest(), Identity.of(scene))
    else:
        directory.require_writable()


@contextmanager
def kept(writer: ResultWriter, new: bool) -> Iterator[None]:
    """Removes a new store when its run is refused late, or fails before it can be resumed."""
    try:
        yield
    except (InputError, OSError) as error:
        first = not checkpoint_file(writer.path).exists()
        refused = isinstance(error, InputError) and not isinstance(error, Damaged)
        if new and (first or refused):
            writer.discard()
        raise
