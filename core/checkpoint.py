"""What a stopped run needs to go on exactly where its stored steps end."""

import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from sparsemor.core.zarr_files import replace_file


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """stored: number of steps in the store at that moment. arrays: the integrator's state.

    memory is the step solver's, pickled: open checkpoints of your own runs only. run is the
    identity of the store they belong to.
    """

    run: str
    stored: int
    arrays: Mapping[str, NDArray[Any]]
    memory: Any


def checkpoint_file(store: Path) -> Path:
    """Beside the store, not in it: a Zarr reader meets only Zarr."""
    return store.with_suffix(".checkpoint")


def save_checkpoint(store: Path, checkpoint: Checkpoint) -> None:
    """Replaces the earlier one as a whole."""
    content = (checkpoint.run, checkpoint.stored, dict(checkpoint.arrays), checkpoint.memory)
    replace_file(checkpoint_file(store), pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL))


def load_checkpoint(store: Path) -> Checkpoint | None:
    """None when there is none."""
    file = checkpoint_file(store)
    if not file.exists():
        return None
    return Checkpoint(*pickle.loads(file.read_bytes()))
