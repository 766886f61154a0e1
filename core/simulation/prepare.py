"""Preparation of a run: input checks, model, rigid-body pre-simulation and offline data."""

from sparsemor.core.model.body_cache import BodyCache
from sparsemor.core.model.model import Model
from sparsemor.core.registry.hooks import Manager
from sparsemor.core.scene.scene import Scene
from sparsemor.core.simulation.cache import Cache
from sparsemor.core.simulation.memory.disk import room_for_snapshots
from sparsemor.core.simulation.memory.estimate import fitting
from sparsemor.core.simulation.offline import Offline
from sparsemor.core.simulation.offline_cache import Products
from sparsemor.core.simulation.rigid_stage import staged
from sparsemor.core.simulation.training import offline_of
from sparsemor.core.simulation.validation import checked_model


def prepared(
    scene: Scene, cache: Cache, manager: Manager, body_cache: BodyCache | None = None
) -> tuple[Model, Offline]:
    """Model and offline data from which a reducer is prepared. The rigid-body pre-simulation of a
    two-stage scene is run here, or read from the cache.

    Raises InputError as `checked_model` does, and if the run would not fit in memory or its
    snapshots not on the disk; SolveFailed if the pre-simulation stops early.
    """
    body_cache, products = body_cache or BodyCache(), Products(cache)
    if scene.rigid_stage is None:
        model = checked_model(scene, body_cache)
    else:
        checked_model(scene, body_cache)  # which is not held next to the one that is run
        model = staged(scene, products, manager, body_cache)
    offline = offline_of(scene, model, products, manager, body_cache)
    offline.expected = fitting(scene, model, offline).total
    room_for_snapshots(scene, model, offline)
    return model, offline
