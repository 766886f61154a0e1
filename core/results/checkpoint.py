"""Checkpoint: the state from which a stopped run continues exactly after its last checkpointed
step."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsemor.core.results.atomic_files import replace_file
from sparsemor.core.results.saved_state import Saved, SavedError


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Checkpoint of a run. run: identifier of the store that it belongs to; stored: number of steps
    in the store at that moment; arrays: state of the time integrator; memory: serialized state of
    the step solver (saved_state.py)."""

    run: str
    stored: int
    arrays: Mapping[str, NDArray[Any]]
    memory: Saved


def checkpoint_file(store: Path) -> Path:
    """Path of the checkpoint, next to the folder of the result."""
    return store.with_suffix(".checkpoint")


def save_checkpoint(store: Path, checkpoint: Checkpoint) -> None:
    """Writes the checkpoint of a store; an earlier one is replaced atomically."""
    memory = checkpoint.memory
    head = Saved.of((checkpoint.run, checkpoint.stored, dict(checkpoint.arrays)), "checkpoint")
    tree = {"head": head.tree, "own": len(head.arrays), "memory": memory.tree}
    replace_file(checkpoint_file(store), Saved(tree, (*head.arrays, *memory.arrays)).dump())


def load_checkpoint(store: Path) -> Checkpoint | None:
    """Checkpoint of a store, None if there is none; nothing in the file is executed.

    Raises SavedError for a file that is damaged or of another format.
    """
    file = checkpoint_file(store)
    if not file.exists():
        return None
    read = Saved.load(file.read_bytes())
    try:
        own = int(read.tree["own"])
        head = Saved(read.tree["head"], read.arrays[:own]).into(("", 0, {}), "checkpoint")
        run, stored, arrays = head
        memory = Saved(read.tree["memory"], read.arrays[own:])
    except (KeyError, TypeError, ValueError) as error:
        raise SavedError(f"it has not the fields of a checkpoint ({error})") from None
    if not all(isinstance(a, np.ndarray) for a in arrays.values()):
        raise SavedError("its state is not made of arrays")
    return Checkpoint(run, stored, arrays, memory)
