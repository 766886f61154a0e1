"""Worker process for training runs (`python -m` this module)."""

import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sparsemor.core.simulation.workers.worker_loop import Execute, serve


def training() -> Execute:
    """Execution of one training run, whose snapshots are stored in the cache."""
    from sparsemor.core.linalg.threads import fixed_threads
    from sparsemor.core.registry.hooks import new_manager
    from sparsemor.core.registry.registry import Registry
    from sparsemor.core.scene.run_identity import training_physics
    from sparsemor.core.scene.scene import build
    from sparsemor.core.scene.source import Source
    from sparsemor.core.scene.yaml_reader import Document
    from sparsemor.core.simulation.cache import Cache
    from sparsemor.core.simulation.offline_cache import Products
    from sparsemor.core.simulation.training import train

    def execute(job: Mapping[str, Any]) -> dict[str, Any]:
        """Makes the training run of a job (`train_in_parallel`) and stores it in the cache."""
        try:
            with fixed_threads():
                tree = dict(job["tree"])
                scene, _ = training_physics(build(Source(
                    Document(job["name"], tree), tree, Registry(), Path(job["folder"]))),
                    job["changes"])
                products = Products(Cache(job["cache"]))
                products.remember("training", job["key"],
                                  lambda: train(scene, new_manager(()), products))
        except Exception:  # its error is met where the run is made again
            traceback.print_exc()
            return {"stored": False}
        return {"stored": True}

    return execute


if __name__ == "__main__":
    serve(training)
