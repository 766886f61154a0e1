"""Training runs at several points of the box of parameters, made by worker processes at once. Each
stores its snapshots in the cache, with the digits of a run in this process."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.workers.local_pool import LocalPool

PROGRAM = "sparsemor.core.simulation.workers.training_worker"
"""Program of the worker processes."""
WAIT = 0.5
"""Interval at which Ctrl-C is noticed, s."""


def train_in_parallel(
    scene: Scene, changes: Mapping[str, Mapping[str, Any]], cache: Cache, workers: int,
    report: Callable[[int], object],
) -> None:
    """Makes the training runs of a scene with their changes by key, and stores them in the cache
    under these keys. report: called at the start and with the number of finished runs.

    A run that failed, or whose process died, is not stored: the caller makes it again and meets its
    error.
    """
    source = scene.source
    data = {"tree": source.tree, "name": source.document.name, "folder": str(scene.folder),
            "cache": str(cache.root)}
    pool = LocalPool(min(workers, len(changes)), Path(os.devnull), PROGRAM)
    try:
        waiting, running, done = list(changes), 0, 0
        report(done)
        while waiting or running:
            while waiting and running < pool.slots:
                key = waiting.pop(0)
                pool.submit(key, {**data, "key": key, "changes": dict(changes[key])})
                running += 1
            if pool.next(WAIT) is not None:
                running, done = running - 1, done + 1
                report(done)
    finally:
        pool.close()
