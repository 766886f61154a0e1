"""Admission of a run to its output directory, and what a refused run leaves there."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sparsemor.core.checkpoint import checkpoint_file
from sparsemor.core.errors import Damaged, InputError
from sparsemor.core.identity import Identity
from sparsemor.core.replaced import STORE
from sparsemor.core.scene import Scene
from sparsemor.core.store import ResultWriter


def admit(scene: Scene, out: Path, resume: bool) -> None:
    """Raises InputError when a run may not write to `out`: asked before anything is computed."""
    store = out / STORE
    if resume:
        ResultWriter.resumable(store, scene.digest(), Identity.of(scene))
        return
    if store.exists():
        raise InputError(f"{out} already holds a result: continue it with --resume, replace "
                         "it with --force, or name another directory", "out")
    place = out
    while not place.exists():
        place = place.parent
    if not place.is_dir() or not os.access(place, os.W_OK):
        raise InputError(f"{out}: nothing can be written to {place}: name another directory", "out")


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
