"""Disk space of a run: refusal if its snapshots or its result would not fit."""

import shutil
from pathlib import Path

from sparsemor.core.errors import InputError
from sparsemor.core.linalg.snapshots import HELD
from sparsemor.core.model.model import Model
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.memory.estimate import (
    block_sizes,
    chosen_bases,
    duration,
    most_atoms,
    trains,
)
from sparsemor.core.simulation.memory.limits import gb
from sparsemor.core.simulation.offline import Offline, snapshot_count, step_count


def room_for_snapshots(scene: Scene, model: Model, offline: Offline) -> None:
    """Checks that snapshots that are written to disk fit there. Raises InputError."""
    cache = offline.products.cache
    blocks = block_sizes(model)
    if not trains(scene, blocks, model) or offline.has_training() or cache is None:
        return
    M = snapshot_count(scene)
    sizes = [8 * n * M for n in blocks.values()]
    wanted = sum(size for size in sizes if size > HELD)
    place = _existing(cache.root)
    free = shutil.disk_usage(place).free
    if wanted > free:
        raise InputError(
            f"the snapshots of the training run would take {gb(wanted)}, and {place} has "
            f"{gb(free)} left: use a larger training.every, or set SPARSEMOR_CACHE to another "
            "directory")


def room_for_result(scene: Scene, model: Model, out: Path) -> None:
    """Checks that the stored steps of a run fit on the disk of `out`. Raises InputError."""
    blocks = block_sizes(model)
    numbers = model.layout.size - sum(blocks.values()) + 4  # time, iterations, error, seconds
    numbers += sum(p.displacement.shape[0] if p.displacement is not None else 3
                   for p in model.probes)
    bases = chosen_bases(scene, blocks)
    numbers += sum(most_atoms(bases[n], size) if n in bases else size for n, size in blocks.items())
    rows = step_count(scene) // scene.output.every + 2
    free = shutil.disk_usage(_existing(out)).free
    if 8 * numbers * rows > free:
        raise InputError(
            f"the result would take about {gb(8 * numbers * rows)} on the disk ({rows:.3g} stored "
            f"steps of {numbers} numbers), which has {gb(free)} left, and the run "
            f"{duration(step_count(scene))} at the least: take a larger output.every, a larger "
            "time.step or an earlier time.end", "time.step")


def _existing(path: Path) -> Path:
    """The path, or the first folder above it that exists."""
    return next((p for p in (path, *path.absolute().parents) if p.exists()), Path("/"))
